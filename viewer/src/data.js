// Reads what the page holds: a description (JSON) and numbers (one block of bytes, base64).

const KINDS = { f4: Float32Array, f8: Float64Array, i2: Int16Array, u1: Uint8Array, u4: Uint32Array };

/** A table of numbers over time: `rows` of `width`; one row: it does not change. */
export class Track {
  constructor(buffer, { kind, at, rows, width, step }) {
    const raw = new KINDS[kind](buffer, at, rows * width);
    this.values = step === undefined ? raw : Float32Array.from(raw, (x) => x * step);
    this.rows = rows;
    this.width = width;
  }

  /** The numbers at a place of a clock, interpolated between its samples. */
  at({ row, part }, out = []) {
    const { values, width, rows } = this;
    const a = rows === 1 ? 0 : row * width;
    const b = rows === 1 || row + 1 >= rows ? a : a + width;
    for (let i = 0; i < width; i += 1) out[i] = values[a + i] * (1 - part) + values[b + i] * part;
    return out;
  }

  /** A number of one row, without interpolation. */
  get(row, column = 0) {
    return this.values[this.rows === 1 ? column : row * this.width + column];
  }
}

/** Times of samples [s]; `find` gives the place of a time among them. */
export class Clock {
  constructor(track) {
    this.times = track.values;
  }

  find(time) {
    const { times } = this;
    const last = times.length - 1;
    if (last < 1 || time <= times[0]) return { row: 0, part: 0 };
    if (time >= times[last]) return { row: last - 1, part: 1 };
    let low = 0;
    let high = last;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle;
      else high = middle;
    }
    return { row: low, part: (time - times[low]) / (times[high] - times[low]) };
  }

  /** The sample that holds at a time: the last one before it. */
  holds(time) {
    const { row, part } = this.find(time);
    return part >= 1 ? row + 1 : row;
  }
}

export function read(document) {
  const scene = JSON.parse(document.getElementById("scene").textContent);
  const text = atob(document.getElementById("numbers").textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i += 1) bytes[i] = text.charCodeAt(i);
  const tracks = scene.arrays.map((entry) => new Track(bytes.buffer, entry));
  const track = (index) => (index === null || index === undefined ? null : tracks[index]);
  const clocks = { time: new Clock(track(scene.time)) };
  clocks.contact = scene.contact_time === null ? clocks.time : new Clock(track(scene.contact_time));
  return { scene, track, clocks };
}
