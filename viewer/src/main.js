// The viewer: one page that shows a motion. `window.viewer` is its small interface for tests and for the page around it.
import { read } from "./data.js";
import { complete } from "./model.js";
import { plain, say, STATE_COLOURS, STATES } from "./numbers.js";
import { Page } from "./page.js";
import { Plots } from "./plots.js";
import { draw, Play } from "./section.js";
import { Stage } from "./stage.js";

const SECONDS = 10;

class Viewer {
  constructor() {
    const all = read(document);
    complete(all);
    const { scene, clocks } = all;
    Object.assign(this, { scene, time: clocks.time.times[0], playing: false, frames: 0, firstFrame: null, selected: null });
    [this.first, this.last] = [clocks.time.times[0], clocks.time.times.at(-1)];
    this.times = clocks.time.times;
    this.page = new Page(scene, this);
    this.stage = new Stage(this.page.canvas, all);
    this.plots = new Plots(this.page.plots, all, (time) => (time === null ? this.draw() : this.setTime(time)));
    this.plays = scene.joints.map(({ contact }) => (contact?.outline ? new Play(contact, all) : null));
    this.forces = scene.joints.map(({ contact, reaction }) => (contact ? all.track(contact.force) : all.track(reaction)));
    this.clocks = clocks;
    this.track = all.track;
    this.speed = this._slowest();
    this.page.setSpeeds(this.speed);
    this.stage.controls.addEventListener("change", () => this.draw());
    new ResizeObserver(() => this.resize()).observe(this.page.canvas.parentElement);
    new ResizeObserver(() => this.resize()).observe(this.page.plots.parentElement);
    this.setExaggeration(scene.exaggeration.start);
    this.select(scene.chosen);
    this.resize();
  }

  /** So many times slower that the motion lasts ten seconds. */
  _slowest() {
    const ratio = SECONDS / (this.last - this.first);
    const power = 10 ** Math.floor(Math.log10(ratio));
    return power * [5, 2, 1].find((k) => k * power <= ratio * 1.0001);
  }

  resize() {
    this.stage.resize();
    this.plots.resize();
    this.draw();
  }

  /** Draw once, at the next picture of the screen. */
  draw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => this._frame(now));
  }

  _frame(now) {
    this.asked = false;
    if (this.playing) {
      if (this.before !== undefined) {
        this.time += (now - this.before) / 1000 / this.speed;
        this.stage.adapt((now - this.before) / 1000);
      }
      this.before = now;
      if (this.time >= this.last) this.time = this.first;
    }
    this.stage.show(this.time);
    this.plots.show(this.time);
    this.page.show(this.time);
    this._section();
    this.frames += 1;
    if (this.firstFrame === null) this.firstFrame = performance.now();
    if (this.playing) this.draw();
  }

  _section() {
    if (this.selected === null) return;
    const joint = this.scene.joints[this.selected];
    const play = this.plays[this.selected];
    if (play) {
      play.at(this.time);
      this.page.sections.forEach(([canvas, view]) => draw(canvas, play, view));
    }
    this.page.setFacts(this._facts(joint, play));
  }

  /** What is known of the chosen joint now, as rows of a word and a value. */
  _facts(joint, play) {
    const force = Math.hypot(...this.forces[this.selected].at(this.clocks[joint.contact ? "contact" : "time"].find(this.time)));
    const rows = [[joint.contact ? "contact force" : "force", say(force, "N")]];
    if (!joint.contact) return rows;
    const state = this.track(joint.contact.state).get(this.clocks.contact.holds(this.time));
    rows.unshift(["state", STATES[state], STATE_COLOURS[state]]);
    if (joint.contact.peak) rows.push(["largest force", `${say(joint.contact.peak.force, "N")} at ${say(joint.contact.peak.time, "s", 4)}`]);
    if (!play) return rows;
    const { outline } = joint.contact;
    const off = outline.height ? Math.max(...play.now.slice(0, 2).map(Math.abs)) : Math.hypot(...play.now.slice(0, outline.ball ? 3 : 2));
    rows.push(["eccentricity", `${say(off, "m")} = ${plain(off / outline.clearance, 3)} of the clearance`]);
    rows.push(["clearance", say(outline.clearance, "m")]);
    if (outline.axial) rows.push(["axial shift", `${say(play.now[2], "m")} of ±${say(outline.axial, "m")}`]);
    if (play.tilt) rows.push(["tilt", say(Math.hypot(...play.lean), "rad")]);
    rows.push(["wear", play.deepest > 0 ? `${say(play.deepest, "m")} at the deepest` : "none"]);
    return rows;
  }

  // The interface ---------------------------------------------------------------------------------------------------

  setTime(time) {
    this.time = Math.min(Math.max(time, this.first), this.last);
    this.draw();
  }

  /** The next or the last sample. */
  step(by) {
    const row = this.clocks.time.holds(this.time);
    this.setTime(this.times[Math.min(Math.max(row + by, 0), this.times.length - 1)]);
  }

  play() {
    this.playing = true;
    this.before = undefined;
    this.page.setPlaying(true);
    this.draw();
  }

  pause() {
    this.playing = false;
    this.stage.adapt(null);
    this.page.setPlaying(false);
    this.draw();
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  setExaggeration(factor) {
    this.stage.setFactor(factor);
    this.page.setFactor(factor, this.stage);
    this.draw();
  }

  get exaggeration() {
    return this.stage.factor;
  }

  /** Open a joint by its index or name; `null` closes it. */
  select(joint) {
    const index = typeof joint === "string" ? this.scene.joints.findIndex(({ name }) => name === joint) : joint;
    this.selected = index === null || index < 0 ? null : index;
    this.stage.selected = this.selected;
    this.plots.choose(this.selected);
    this.page.open(this.selected);
    this.draw();
  }

  /** The next joint, or the one before. */
  next(by) {
    const count = this.scene.joints.length;
    if (count) this.select(this.selected === null ? 0 : (this.selected + by + count) % count);
  }

  show(what, there) {
    this.stage.shown[what] = there;
    this.page.setShown(what, there);
    this.draw();
  }

  fit() {
    this.stage.fit();
    this.draw();
  }

  /** Places of the marks as drawn now, and of the ideal ones [m]. */
  positions() {
    this.stage.place(this.time);
    const list = (places) => places.map((place) => place.toArray());
    return { shown: list(this.stage.actual), ideal: list(this.stage.ideal) };
  }

  /** Where a joint is on the page [px]. */
  jointOnPage(name) {
    const joint = this.scene.joints.find((entry) => entry.name === name);
    const { left, top } = this.page.canvas.getBoundingClientRect();
    const [x, y] = this.stage.onPage(this.stage.actual[joint.mark]);
    return [left + x, top + y];
  }
}

window.viewer = new Viewer();
