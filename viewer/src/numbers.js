// Numbers for people, and colours that colour-blind people tell apart (Okabe and Ito).

export const COLOURS = {
  blue: "#0072B2", sky: "#56B4E9", green: "#009E73", orange: "#E69F00", vermillion: "#D55E00", purple: "#CC79A7",
  grey: "#7A8793", ink: "#1E2A36", faint: "#8A96A3", line: "#DCE2E8",
};
export const BODIES = [COLOURS.blue, COLOURS.orange, COLOURS.green, COLOURS.sky, "#B8A100", COLOURS.grey];
export const CURVES = [COLOURS.blue, COLOURS.vermillion, COLOURS.green, COLOURS.orange, COLOURS.purple, COLOURS.sky, "#000000"];
// Contact states: 0 free, 1 contact, 2 impact.
export const STATES = ["free", "contact", "impact"];
export const STATE_COLOURS = ["#E4E9EE", COLOURS.sky, COLOURS.vermillion];

const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"], [1e-12, "p"]];

/** The factor and the unit in which a value has one to three digits before the point. */
export function scaleOf(value, unit) {
  if (unit === "1" || unit === "" || !(Math.abs(value) > 0)) return [1, unit === "1" ? "" : unit];
  const [factor, prefix] = PREFIXES.find(([size]) => Math.abs(value) >= size * 0.9999) ?? PREFIXES.at(-1);
  return factor > 1 && unit !== "N" && unit !== "Pa" ? [1, unit] : [1 / factor, prefix + unit];
}

/** A value with its unit, three digits. */
export function say(value, unit, digits = 3) {
  if (value === null || !Number.isFinite(value)) return "–";
  const [factor, word] = scaleOf(value, unit);
  return `${plain(value * factor, digits)} ${word}`.trim();
}

export function plain(value, digits = 3) {
  const text = Number(value.toPrecision(digits)).toString().replace("-", "−");
  return text.includes("e") ? text.replace(/e\+?(-?)(\d+)/, "·10^$1$2") : text;
}

/** The largest of 1, 2, 5, 10 ... that is not above a value. */
export function roundDown(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * ([5, 2].find((k) => k * power <= value * 1.0001) ?? 1);
}

/** The least of 1, 2, 2.5, 5, 10 ... that is not below a value. */
export function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 2.5, 5, 10].find((k) => k * power >= value * 0.9999);
}
