// Plots under the time line: errors, forces, eccentricities and contact states over time. A click or a drag in them moves
// the time; the wheel widens a part of it.
import { COLOURS, CURVES, plain, roundUp, say, scaleOf, STATE_COLOURS, STATES } from "./numbers.js";

const [LEFT, RIGHT, TOP, STRIP, AXIS] = [66, 14, 22, 8, 22];
const FONT = "11px system-ui, sans-serif";

export class Plots {
  constructor(canvas, { scene, track, clocks }, seek) {
    Object.assign(this, { canvas, scene, clocks, seek, chosen: null });
    this.whole = [clocks.time.times[0], clocks.time.times.at(-1)];
    this.range = [...this.whole];
    this.rows = scene.plots.map((plot) => ({ ...plot, curves: plot.curves.map((curve) => this._curve(curve, track)) }));
    this.states = scene.joints.flatMap((entry, i) => (entry.contact ? [{ joint: i, name: entry.name, track: track(entry.contact.state) }] : []));
    this.layer = document.createElement("canvas");
    this._listen();
  }

  _curve(curve, track) {
    const clock = this.clocks[curve.clock];
    const table = track(curve.values);
    const scale = curve.scale ?? 1;
    const norm = Float64Array.from(clock.times, (_, row) => {
      let sum = 0;
      for (let k = 0; k < table.width; k += 1) {
        if (k >= (curve.across ?? table.width)) break;
        if (curve.largest) sum = Math.max(sum, table.get(row, k) ** 2);
        else sum += table.get(row, k) ** 2;
      }
      return Math.sqrt(sum) * scale;
    });
    return { ...curve, times: clock.times, values: norm, now: ({ row, part }) => norm[row] * (1 - part) + norm[Math.min(row + 1, norm.length - 1)] * part, place: clock };
  }

  get height() {
    const strips = this.states.length ? 20 + this.states.length * (STRIP + 3) : 0;
    return this.rows.length * this.rowHeight + strips + AXIS;
  }

  get rowHeight() {
    return this.canvas.clientWidth < 560 ? 82 : 62;
  }

  resize() {
    this.canvas.style.height = `${this.height}px`;
    const dots = Math.min(window.devicePixelRatio, 2);
    for (const canvas of [this.canvas, this.layer]) {
      canvas.width = Math.round(this.canvas.clientWidth * dots);
      canvas.height = Math.round(this.height * dots);
    }
    this.dots = dots;
    this._paint();
  }

  choose(joint) {
    this.chosen = joint;
    this._paint();
  }

  x(time) {
    const [a, b] = this.range;
    return LEFT + ((time - a) / (b - a)) * (this.canvas.clientWidth - LEFT - RIGHT);
  }

  time(x) {
    const [a, b] = this.range;
    return Math.min(Math.max(a + ((x - LEFT) / (this.canvas.clientWidth - LEFT - RIGHT)) * (b - a), a), b);
  }

  /** The curves as they are, with a line at the time and the values there. */
  show(time) {
    const c = this.canvas.getContext("2d");
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, this.canvas.width, this.canvas.height);
    c.drawImage(this.layer, 0, 0);
    c.setTransform(this.dots, 0, 0, this.dots, 0, 0);
    const x = Math.round(this.x(time)) + 0.5;
    if (time >= this.range[0] && time <= this.range[1]) {
      c.strokeStyle = COLOURS.ink;
      c.lineWidth = 1;
      c.beginPath();
      c.moveTo(x, 2);
      c.lineTo(x, this.height - AXIS);
      c.stroke();
      c.fillStyle = COLOURS.ink;
      c.beginPath();
      c.moveTo(x - 5, 0);
      c.lineTo(x + 5, 0);
      c.lineTo(x, 7);
      c.fill();
    }
    this.rows.forEach((row, i) => this._values(c, row, i, time));
  }

  _ordered(row) {
    return [...row.curves].sort((a, b) => (a.joint === this.chosen && a.joint !== undefined) - (b.joint === this.chosen && b.joint !== undefined));
  }

  _dims(curve) {
    return this.chosen !== null && curve.joint !== undefined && curve.joint !== this.chosen && this.states.some((s) => s.joint === this.chosen);
  }

  _values(c, row, i, time) {
    c.font = FONT;
    let x = this.canvas.clientWidth - RIGHT;
    const y = i * this.rowHeight + 14;
    for (const curve of this._ordered(row).reverse()) {
      const text = `${curve.name} ${say(curve.now(curve.place.find(time)), row.unit)}`;
      const width = c.measureText(text).width;
      if (x - width - 16 < LEFT + this.titles[i]) break;
      c.fillStyle = this._dims(curve) ? COLOURS.faint : COLOURS.ink;
      c.fillText(text, x - width, y);
      c.strokeStyle = this._colour(curve, row);
      c.globalAlpha = this._dims(curve) ? 0.4 : 1;
      c.lineWidth = 3;
      c.setLineDash(this._dash(curve, row));
      c.beginPath();
      c.moveTo(x - width - 15, y - 4);
      c.lineTo(x - width - 4, y - 4);
      c.stroke();
      c.setLineDash([]);
      c.globalAlpha = 1;
      x -= width + 26;
    }
  }

  _colour(curve, row) {
    return CURVES[row.curves.indexOf(curve) % CURVES.length];
  }

  _dash(curve, row) {
    return row.curves.indexOf(curve) < CURVES.length ? [] : [5, 3];
  }

  _paint() {
    const c = this.layer.getContext("2d");
    const width = this.canvas.clientWidth;
    if (!(width > 0)) return;
    c.setTransform(this.dots, 0, 0, this.dots, 0, 0);
    c.clearRect(0, 0, width, this.height);
    c.font = FONT;
    this.titles = this.rows.map(({ title, cut }) => c.measureText(title).width + 12 + (cut && width >= 560 ? c.measureText(cut).width + 24 : 0));
    this.rows.forEach((row, i) => this._row(c, row, i * this.rowHeight, width));
    this._strips(c, this.rows.length * this.rowHeight, width);
    this._axis(c, width);
  }

  _row(c, row, top, width) {
    const [low, high] = [top + TOP, top + this.rowHeight - 8];
    const every = row.curves.map((curve) => curve.values.reduce((m, v) => (v > m ? v : m), 0));
    const largest = row.top ?? Math.max(...every, 0);
    const most = largest * 1.06 || 1;
    const y = (value) => high - (Math.min(value, most) / most) * (high - low);
    const [factor, unit] = scaleOf(largest, row.unit);
    c.fillStyle = COLOURS.ink;
    c.textAlign = "left";
    c.font = `600 ${FONT}`;
    c.fillText(row.title, LEFT, top + 14);
    c.font = FONT;
    c.textAlign = "right";
    const step = roundUp(most / 3);
    for (let value = 0; value <= most; value += step) {
      const level = Math.round(y(value)) + 0.5;
      c.strokeStyle = COLOURS.line;
      c.lineWidth = 1;
      c.beginPath();
      c.moveTo(LEFT, level);
      c.lineTo(width - RIGHT, level);
      c.stroke();
      c.fillStyle = COLOURS.faint;
      c.fillText(`${plain(value * factor, 3)} ${value + step > most ? unit : ""}`.trim(), LEFT - 6, level + 3.5);
    }
    c.textAlign = "left";
    c.save();
    c.beginPath();
    c.rect(LEFT, low - 4, width - LEFT - RIGHT, high - low + 5);
    c.clip();
    for (const curve of this._ordered(row)) {
      c.strokeStyle = this._colour(curve, row);
      c.globalAlpha = this._dims(curve) ? 0.22 : 1;
      c.lineWidth = this._dims(curve) ? 1 : 1.6;
      c.setLineDash(this._dash(curve, row));
      c.beginPath();
      curve.times.forEach((time, k) => c[k ? "lineTo" : "moveTo"](this.x(time), y(curve.values[k])));
      c.stroke();
    }
    c.restore();
    if (row.cut) {
      c.fillStyle = COLOURS.faint;
      const beside = width >= 560;
      c.fillText(row.cut, LEFT + (beside ? c.measureText(row.title).width + 24 : 22), beside ? top + 14 : low + 9);
    }
  }

  _strips(c, top, width) {
    if (!this.states.length) return;
    c.fillStyle = COLOURS.ink;
    c.font = `600 ${FONT}`;
    c.fillText("Contact", LEFT, top + 13);
    c.font = FONT;
    let x = LEFT + 62;
    STATES.forEach((word, i) => {
      c.fillStyle = STATE_COLOURS[i];
      c.fillRect(x, top + 5, 10, 10);
      c.fillStyle = COLOURS.faint;
      c.fillText(word, x + 14, top + 14);
      x += 30 + c.measureText(word).width;
    });
    this.states.forEach(({ joint, name, track }, i) => {
      const y = top + 20 + i * (STRIP + 3);
      c.fillStyle = joint === this.chosen ? COLOURS.ink : COLOURS.faint;
      c.font = joint === this.chosen ? `600 ${FONT}` : FONT;
      c.textAlign = "right";
      let label = name;
      while (label.length > 2 && c.measureText(label).width > LEFT - 10) label = `${label.slice(0, -2)}…`;
      c.fillText(label, LEFT - 6, y + STRIP - 0.5);
      c.textAlign = "left";
      this._strip(c, track, y, width);
    });
  }

  /** One joint's states: the gravest one in every pixel. */
  _strip(c, track, y, width) {
    const { times } = this.clocks.contact;
    const pixels = new Int8Array(Math.ceil(width)).fill(-1);
    for (let k = 0; k < times.length; k += 1) {
      const from = Math.max(Math.floor(this.x(times[k])), LEFT);
      const to = Math.min(Math.ceil(this.x(times[Math.min(k + 1, times.length - 1)])), width - RIGHT);
      for (let x = from; x < to; x += 1) pixels[x] = Math.max(pixels[x], track.get(k));
    }
    for (let x = LEFT, begin = LEFT; x <= width - RIGHT; x += 1) {
      if (pixels[x] === pixels[begin]) continue;
      if (pixels[begin] >= 0) {
        c.fillStyle = STATE_COLOURS[pixels[begin]];
        c.fillRect(begin, y, x - begin, STRIP);
      }
      begin = x;
    }
  }

  _axis(c, width) {
    const [a, b] = this.range;
    const y = this.height - AXIS;
    const [factor, unit] = scaleOf(Math.max(Math.abs(a), Math.abs(b)), "s");
    const count = width < 560 ? 3 : 6;
    const raw = (b - a) / count;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 5, 10].find((k) => k * power >= raw);
    c.fillStyle = COLOURS.faint;
    c.font = FONT;
    c.textAlign = "center";
    for (let k = Math.ceil(a / step - 1e-9); k * step <= b * (1 + 1e-9); k += 1) {
      const x = this.x(k * step);
      c.fillRect(x, y, 1, 4);
      c.fillText(`${plain(k * step * factor, 6)} ${unit}`, Math.min(Math.max(x, 20), width - 22), y + 16);
    }
    c.textAlign = "left";
  }

  _listen() {
    let drags = false;
    const go = (event) => this.seek(this.time(event.clientX - this.canvas.getBoundingClientRect().left));
    this.canvas.addEventListener("pointerdown", (event) => {
      drags = true;
      this.canvas.setPointerCapture(event.pointerId);
      go(event);
    });
    this.canvas.addEventListener("pointermove", (event) => drags && go(event));
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, () => { drags = false; });
    this.canvas.addEventListener("dblclick", () => this.zoom(Infinity));
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.time(event.clientX - this.canvas.getBoundingClientRect().left));
    }, { passive: false });
  }

  /** Show a longer or shorter part of the time around an instant; endless: all of it. */
  zoom(by, around = this.range[0]) {
    const [first, last] = this.whole;
    const lasts = Math.min(Math.max((this.range[1] - this.range[0]) * by, (last - first) * 1e-5), last - first);
    if (!Number.isFinite(by) || lasts >= last - first) this.range = [first, last];
    else {
      const share = (around - this.range[0]) / (this.range[1] - this.range[0]);
      const begin = Math.min(Math.max(around - share * lasts, first), last - lasts);
      this.range = [begin, begin + lasts];
    }
    this._paint();
    this.seek(null);
  }
}
