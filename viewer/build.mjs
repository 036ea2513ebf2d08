// Bundles the sources and three.js to one script in the Python package, with the hash of the sources in its first line.
import { createHash } from "node:crypto";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const target = join(here, "..", "clearance_jax", "viewer", "static");

// The same files in the same order as in tests/view/test_bundle.py: those that decide what the bundle holds.
const sources = readdirSync(join(here, "src")).sort().map((name) => join("src", name));
const hash = createHash("sha256");
for (const name of ["build.mjs", "package-lock.json", "package.json", ...sources]) hash.update(readFileSync(join(here, name)));

const { outputFiles } = await build({
  entryPoints: [join(here, "src", "main.js")],
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  loader: { ".css": "text" },
  legalComments: "none",
  charset: "ascii",
  write: false,
});
const script = outputFiles[0].text;
if (/<\/script|<!--/i.test(script)) throw new Error("The bundle would end the page's <script>: change the source.");
writeFileSync(join(target, "viewer.js"), `/* sources ${hash.digest("hex")}; three.js: MIT, see three-LICENSE.txt */\n${script}`);
writeFileSync(join(target, "three-LICENSE.txt"), readFileSync(join(here, "node_modules", "three", "LICENSE")));
console.log(`viewer.js ${(script.length / 1024).toFixed(0)} KiB`);
