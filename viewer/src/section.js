// A clearance joint magnified: sections across it and along it. Bodies have their true size; displacement, tilt and
// wear are multiplied by one factor. The numbers are those of the joint's own outline in the dataset.
import { COLOURS } from "./numbers.js";

const [WALL, OUT, COLLAR, NECK, TRAIL] = [0.3, 0.35, 0.25, 0.6, 150];
const STYLE = { sleeve: "#C9D6E3", pin: "#E9EDF1", edge: "#5B6875" };

/** The play of a joint at a time: the pin's `place` and `tilt` in the sleeve's axes, its `turn`. */
export class Play {
  constructor(contact, { track, clocks }) {
    const { outline } = contact;
    Object.assign(this, { contact, outline, factor: contact.factor, clock: clocks.contact, samples: clocks.time });
    [this.place, this.tilt, this.turn] = [contact.place, contact.tilt, contact.turn].map(track);
    this.depths = outline.depth ?? [[0]];
    this.deepest = Math.max(...this.depths.flat());
    this.wall = outline.radius + this.factor * outline.clearance;
    this.outside = this.wall + WALL * outline.radius + this.factor * this.deepest;
  }

  at(time) {
    this.where = this.clock.find(time);
    this.now = this.place.at(this.where);
    this.lean = this.tilt ? this.tilt.at(this.where) : [0, 0];
    this.angle = this.turn ? this.turn.at(this.samples.find(time))[0] : null;
    const down = Math.sqrt(Math.max(1 - this.lean[0] ** 2 - this.lean[1] ** 2, 1e-12));
    this.slope = this.lean.map((x) => x / down);
  }

  /** The pin's centre at a height along the sleeve. */
  centre(height, place = this.now, lean = this.lean, slope = this.slope) {
    if (!this.outline.length) return [place[0], place[1]];
    const by = this.outline.through ? slope.map((s) => s * (height - (place[2] ?? 0))) : lean.map((s) => s * height);
    return [place[0] + by[0], place[1] + by[1]];
  }

  wear(angle, station) {
    const depth = this.depths[station % this.depths.length];
    const turn = (((angle / (2 * Math.PI)) % 1) + 1) % 1 * depth.length;
    const [i, part] = [Math.floor(turn), turn % 1];
    return depth[i % depth.length] * (1 - part) + depth[(i + 1) % depth.length] * part;
  }

  penetration([x, y], station) {
    const depth = this.depths[station % this.depths.length];
    if (this.deepest === 0) return Math.hypot(x, y) - this.outline.clearance;
    return Math.max(...depth.map((d, i) => {
      const angle = (2 * Math.PI * i) / depth.length;
      return x * Math.cos(angle) + y * Math.sin(angle) - d;
    })) - this.outline.clearance;
  }
}

/** A section across the axis at a height (`station`), or of a ball along two of the sleeve's `axes`. */
function across(pen, play, { station, axes }) {
  const { outline, factor } = play;
  const height = outline.heights[station];
  const middle = (place, lean, slope) => (outline.ball ? axes.map((k) => place[k]) : play.centre(height, place, lean, slope));
  const centre = middle(play.now);
  const around = Array.from({ length: 121 }, (_, i) => (i * 2 * Math.PI) / 120);
  const bore = (angle) => play.wall + factor * play.wear(angle, station);
  pen.circle(0, 0, play.outside, { fill: STYLE.sleeve });
  pen.shape(around.map((a) => [bore(a) * Math.cos(a), bore(a) * Math.sin(a)]), { fill: "#FFFFFF", line: STYLE.edge });
  const [x, y] = centre.map((c) => factor * c);
  pen.circle(x, y, outline.radius, { fill: STYLE.pin, line: STYLE.edge });
  if (play.angle !== null && !outline.ball) {
    const [c, s] = [outline.radius * Math.cos(play.angle), outline.radius * Math.sin(play.angle)];
    pen.path([[x - c, y - s], [x + c, y + s]], { line: "#B6C0CA", width: 1 });
  }
  pen.circle(0, 0, factor * outline.clearance, { line: COLOURS.ink, width: 1, dash: [4, 3] });
  const trail = [];
  for (let i = Math.max(play.where.row - TRAIL, 0); i <= play.where.row; i += 1) {
    const row = (table) => (table ? Array.from({ length: table.width }, (_, k) => table.get(i, k)) : [0, 0]);
    const lean = row(play.tilt);
    trail.push(middle(row(play.place), lean, lean).map((c) => factor * c));
  }
  pen.path([...trail, [x, y]], { line: COLOURS.blue, width: 1.2 });
  pen.dot(x, y, COLOURS.blue);
  const deep = outline.ball ? Math.hypot(...play.now) - outline.clearance : play.penetration(centre, station);
  if (deep > 0) {
    const angle = Math.atan2(y, x);
    const arc = Array.from({ length: 15 }, (_, i) => angle + 0.35 * (i / 7 - 1));
    pen.path(arc.map((a) => [bore(a) * Math.cos(a), bore(a) * Math.sin(a)]), { line: COLOURS.vermillion, width: 5 });
  }
}

/** A section along the axis, which is horizontal; `up`: which of the sleeve's axes is upright. */
function along(pen, play, { up }) {
  const { outline, factor } = play;
  const r = outline.height ? (up === 0 ? outline.height : outline.width ?? 0) / 2 : outline.radius;
  const half = (outline.length ?? 2.2 * r) / 2;
  const wall = r + factor * outline.clearance;
  const thick = WALL * outline.radius;
  const reach = factor * (outline.axial ?? 0);
  const face = outline.through ? half : half + OUT * r;
  for (const low of [wall, -wall - thick]) pen.box(-face, low, 2 * face, thick, { fill: STYLE.sleeve, line: STYLE.edge });
  const slid = play.now[2] ?? 0;
  const [level, slope] = [play.now[up] ?? 0, play.slope[up] ?? 0];
  const move = ([a, c]) => [a + factor * (slid - slope * c), c + factor * (level + slope * a)];
  const box = (left, right, h) => [[left, -h], [right, -h], [right, h], [left, h]];
  const beyond = face + reach;
  const bodies = [box(-beyond - OUT * r, beyond + OUT * r, outline.through ? r : NECK * r)];
  if (!outline.through) {
    if (!outline.axial) bodies.pop();
    bodies.push(box(-half, half, r));
  }
  if (outline.axial) {
    const collar = COLLAR * r;
    bodies.push(box(beyond, beyond + collar, outline.collar), box(-beyond - collar, -beyond, outline.collar));
  }
  bodies.forEach((body) => pen.shape(body.map(move), { fill: STYLE.pin, line: STYLE.edge }));
  pen.path([[-1.05 * face, 0], [1.05 * face, 0]], { line: COLOURS.faint, width: 1, dash: [9, 3, 2, 3] });
  pen.path([[-1.15 * half, 0], [1.15 * half, 0]].map(move), { line: COLOURS.blue, width: 1.2, dash: [9, 3, 2, 3] });
  for (const height of outline.length ? outline.heights : [-half, half]) {
    const centre = play.centre(height);
    const apart = outline.height ? Math.abs(centre[up]) : Math.hypot(...centre);
    const faces = outline.height ? true : Math.abs(centre[up]) >= Math.abs(centre[1 - up]);
    if (apart > outline.clearance && faces) {
      pen.dot(height + (outline.through ? 0 : factor * slid), Math.sign(centre[up]) * wall, COLOURS.vermillion, 4);
    }
  }
}

/** How far a view reaches from its middle [m]: along and up. */
function extent(play, view) {
  const { outline, factor } = play;
  if (view.kind === "across") return [1.04 * play.outside, 1.04 * play.outside];
  const r = outline.height ? Math.max(outline.height, outline.width ?? 0) / 2 : outline.radius;
  const half = (outline.length ?? 2.2 * r) / 2 + (outline.through ? 0 : OUT * r);
  const wide = half + factor * (outline.axial ?? 0) + (OUT + COLLAR) * r;
  const tall = Math.max(r + factor * outline.clearance + 1.2 * WALL * outline.radius, outline.axial ? outline.collar : 0);
  return [1.08 * wide, 1.08 * tall];
}

/** Draws in metres on a canvas, from its middle. */
class Pen {
  constructor(canvas, [wide, tall]) {
    const dots = Math.min(window.devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * dots)) canvas.width = Math.round(width * dots);
    if (canvas.height !== Math.round(height * dots)) canvas.height = Math.round(height * dots);
    this.c = canvas.getContext("2d");
    this.c.setTransform(dots, 0, 0, dots, 0, 0);
    this.c.clearRect(0, 0, width, height);
    this.scale = Math.min(width / (2 * wide), height / (2 * tall));
    this.x = (a) => width / 2 + this.scale * a;
    this.y = (b) => height / 2 - this.scale * b;
    this.c.lineJoin = "round";
  }

  paint({ fill, line, width = 1.3, dash = [] }) {
    if (fill) {
      this.c.fillStyle = fill;
      this.c.fill();
    }
    if (!line) return;
    Object.assign(this.c, { strokeStyle: line, lineWidth: width });
    this.c.setLineDash(dash);
    this.c.stroke();
  }

  path(points, style, closed = false) {
    this.c.beginPath();
    points.forEach(([a, b], i) => this.c[i ? "lineTo" : "moveTo"](this.x(a), this.y(b)));
    if (closed) this.c.closePath();
    this.paint(style);
  }

  shape(points, style) {
    this.path(points, style, true);
  }

  box(left, low, wide, tall, style) {
    this.shape([[left, low], [left + wide, low], [left + wide, low + tall], [left, low + tall]], style);
  }

  circle(a, b, radius, style) {
    this.c.beginPath();
    this.c.arc(this.x(a), this.y(b), Math.max(this.scale * radius, 0), 0, 2 * Math.PI);
    this.paint(style);
  }

  dot(a, b, colour, size = 3) {
    this.c.beginPath();
    this.c.arc(this.x(a), this.y(b), size, 0, 2 * Math.PI);
    this.paint({ fill: colour });
  }
}

const DRAW = { across, along };

export function draw(canvas, play, view) {
  DRAW[view.kind](new Pen(canvas, extent(play, view)), play, view);
}
