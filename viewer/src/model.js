// What the page makes of its numbers: which plots there are, how a joint is seen, how much errors are enlarged.
import { plain, roundDown, say } from "./numbers.js";

// Relative to the mechanism's size: the largest error as it is drawn first. The play as drawn, over the pin's radius.
const [DRAWN, MORE, SHOWN] = [0.04, 5, 0.35];

/** Completes a scene in place. */
export function complete({ scene, track, clocks }) {
  const late = (times) => times.map((time) => scene.settled === null || time > scene.settled);
  const top = (table, times, chosen = null) => largest(table, chosen ?? late(Array.from(times)));
  const { times } = clocks.time;
  scene.clearances = scene.joints.filter((joint) => joint.loose).length;
  const bodies = scene.parts.filter((part) => part.kind === "body");
  bodies.forEach((part, i) => { part.colour = i; });
  scene.subtitle = `${bodies.length} bodies, ${scene.joints.length} joints, ${scene.clearances} with play; ${plain(times.at(-1) - times[0], 4)} s of motion`;
  const error = Math.max(0, ...scene.marks.map((mark) => (mark.error === null ? 0 : top(track(mark.error), times, []))));
  const start = error > 0 ? Math.max(roundDown((DRAWN * scene.size) / error), 1) : 1;
  scene.exaggeration = { start, most: error > 0 ? MORE * start : 1 };
  scene.force = { full: Math.max(0, ...scene.joints.map((joint) => (joint.reaction === null ? 0 : top(track(joint.reaction), times)))) };
  [scene.low, scene.high] = bounds(scene, track, start);
  const means = scene.joints.map(({ contact, reaction }) => {
    if (scene.clearances) return contact ? mean(track(contact.force).values) : -1;
    return reaction === null ? 0 : largest(track(reaction), []);
  });
  scene.chosen = means.length ? means.indexOf(Math.max(...means)) : null;
  scene.joints.forEach(({ contact }) => contact && look(contact));
  scene.plots = plots(scene, (index, chosen) => top(track(index), clocks.contact.times, chosen));
}

const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

/** The largest length of the rows that are chosen; of all, where none is. */
function largest(table, chosen) {
  let most = 0;
  const some = chosen.some(Boolean);
  for (let row = 0; row < table.rows; row += 1) {
    if (some && table.rows > 1 && !chosen[row]) continue;
    let sum = 0;
    for (let k = 0; k < table.width; k += 1) sum += table.get(row, k) ** 2;
    most = Math.max(most, sum);
  }
  return Math.sqrt(most);
}

/** The least and greatest coordinates of all marks, ideal and displaced. */
function bounds(scene, track, factor) {
  const [low, high] = [[0, 0, 0].fill(Infinity), [0, 0, 0].fill(-Infinity)];
  for (const mark of scene.marks) {
    const [ideal, error] = [track(mark.ideal), track(mark.error)];
    for (let row = 0; row < Math.max(ideal.rows, error?.rows ?? 1); row += 1) {
      for (let k = 0; k < 3; k += 1) {
        const at = k < ideal.width ? ideal.get(row, k) : 0;
        const shown = at + (error && k < error.width ? factor * error.get(row, k) : 0);
        low[k] = Math.min(low[k], at, shown);
        high[k] = Math.max(high[k], at, shown);
      }
    }
  }
  return [low, high];
}

/** The views of a joint, by the numbers that its outline has: sections `across` its axis, and `along` it. */
export function look(contact) {
  const { outline } = contact;
  contact.views = [];
  contact.factor = 1;
  if (!outline) return;
  const ratio = (SHOWN * outline.radius) / outline.clearance;
  const power = 10 ** Math.floor(Math.log10(Math.max(ratio, 1)));
  contact.factor = power * Math.floor(Math.max(ratio, 1) / power);
  const along = (up, title) => ({ kind: "along", up, title });
  const across = (station, title, axes = [0, 1]) => ({ kind: "across", station, axes, title });
  if (outline.height) {
    contact.views = (outline.width ? ["x", "y"] : ["x"]).map((way, up) => along(up, `Along the guide, ${way} up`));
  } else if (outline.ball) {
    contact.views = [across(0, "Seen along z"), across(0, "Seen along y", [0, 2])];
  } else if (outline.length) {
    const ends = [0, outline.heights.length - 1].map((k) => across(k, `Across, at z = ${say(outline.heights[k], "m")}`));
    contact.views = [along(0, "Along the axis, x up"), along(1, "Along the axis, y up"), ...ends];
  } else contact.views = [across(0, "Across the axis"), along(0, "Along the axis (its length is not known)")];
}

function plots({ ideal, points, marks, joints, clearances }, top) {
  const rows = [];
  if (ideal && points.length) {
    const curves = points.map(({ name, mark }) => ({ name, clock: "time", values: marks[mark].error }));
    rows.push({ title: "Error against the ideal", unit: "m", curves });
  }
  const curve = (name, joint, clock, values, more) => ({ name, joint, clock, values, ...more });
  const some = joints.map((joint, i) => [joint, i]);
  if (!clearances) {
    const curves = some.filter(([joint]) => joint.reaction !== null).map(([joint, i]) => curve(joint.name, i, "time", joint.reaction));
    if (curves.length) rows.push({ title: "Force in the joints", unit: "N", curves });
    return rows;
  }
  const loose = some.filter(([joint]) => joint.contact);
  const forces = { title: "Contact force", unit: "N", curves: loose.map(([{ name, contact }, i]) => curve(name, i, "contact", contact.force)) };
  const [after, every] = [null, []].map((chosen) => Math.max(...loose.map(([{ contact }]) => top(contact.force, chosen))));
  if (after > 0 && every > 1.5 * after) Object.assign(forces, { top: after, cut: `first fall up to ${say(every, "N")}, cut off` });
  rows.push(forces);
  const known = loose.filter(([{ contact }]) => contact.outline);
  const shares = known.map(([{ name, contact }, i]) => curve(name, i, "contact", contact.place, {
    across: contact.outline.ball ? 3 : 2, largest: Boolean(contact.outline.height), scale: 1 / contact.outline.clearance,
  }));
  if (shares.length) rows.push({ title: "Eccentricity / clearance", unit: "1", curves: shares });
  return rows;
}
