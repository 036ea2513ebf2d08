// The page around the picture: heading, controls, the panel of a joint, keys.
import style from "./style.css";
import { plain, say } from "./numbers.js";

const KEYS = [
  ["space", "play or pause"], ["← →", "one sample back or on"], ["shift ← →", "a tenth of the motion"], ["Home End", "begin or end"],
  [", .", "slower or faster"], ["− +", "show errors smaller or larger"], ["1", "errors at true scale"], ["n p", "next joint or the one before"],
  ["Esc", "close the joint"], ["g f t l", "ghost, forces, paths, names"], ["r", "the first view"], ["?", "this list"],
];
const SPEEDS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000, 50000];
const TOGGLES = [["ghost", "Ideal", "g"], ["forces", "Forces", "f"], ["paths", "Paths", "t"], ["names", "Names", "l"]];

/** An element with attributes and children; texts are text, never markup. */
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  Object.entries(attributes).forEach(([key, value]) => {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (value !== false) element.setAttribute(key, value === true ? "" : value);
  });
  element.append(...children.filter((child) => child !== null));
  return element;
}

function icon(path) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
  line.setAttribute("d", path);
  svg.append(line);
  return svg;
}

export class Page {
  constructor(scene, viewer) {
    Object.assign(this, { scene, viewer, sections: [], labels: [] });
    document.head.append(make("style", {}, style));
    this.canvas = make("canvas", { class: "stage", tabindex: "0", role: "img", "aria-label": `Motion of ${scene.title}` });
    this.plots = make("canvas", { class: "plots", role: "img", "aria-label": "Errors, forces and contact over time; click to go to an instant" });
    const root = document.getElementById("viewer");
    root.append(this._head(), this._picture(), this._time(), this._panel(), this._foot(), this._help());
    this._listen();
  }

  _head() {
    this.clock = make("output", { class: "clock", "aria-label": "time" });
    const about = make("p", {}, this.scene.subtitle);
    return make("header", {}, make("div", {}, make("h1", {}, this.scene.title), about), this.clock);
  }

  _picture() {
    this.chips = make("div", { class: "chips" });
    this.names = make("div", { class: "names", "aria-hidden": "true" });
    const toggles = TOGGLES.map(([what, word, key]) => {
      const off = what === "ghost" && !this.scene.ideal;
      return make("button", { "data-toggle": what, title: `${word} (${key})`, disabled: off, "aria-pressed": String(!off), onclick: () => this._toggle(what) }, word);
    });
    const fit = make("button", { title: "The first view (r)", onclick: () => this.viewer.fit() }, "Fit");
    return make("div", { class: "picture" }, this.canvas, this.names, this.chips, make("div", { class: "toggles" }, ...toggles, fit));
  }

  _toggle(what) {
    const button = document.querySelector(`[data-toggle=${what}]`);
    if (!button.disabled) this.viewer.show(what, button.getAttribute("aria-pressed") !== "true");
  }

  setShown(what, there) {
    document.querySelector(`[data-toggle=${what}]`).setAttribute("aria-pressed", String(there));
  }

  _panel() {
    const { joints } = this.scene;
    const options = joints.map(({ name, loose }, i) => make("option", { value: i }, loose ? `${name} (play)` : name));
    this.list = make("select", { "aria-label": "Joint", onchange: () => this.viewer.select(this.list.value === "" ? null : Number(this.list.value)) },
      make("option", { value: "" }, "Choose a joint"), ...options);
    const turn = (by, word, sign) => make("button", { "aria-label": word, title: word, onclick: () => this.viewer.next(by) }, sign);
    this.detail = make("div", { class: "detail" });
    return make("aside", { "aria-label": "Joint" }, make("div", { class: "pick" }, this.list, turn(-1, "Joint before (p)", "‹"), turn(1, "Next joint (n)", "›")), this.detail);
  }

  /** The panel of a joint: its sections and what is known of it. */
  open(index) {
    this.list.value = index === null ? "" : String(index);
    this.sections = [];
    this.rows = null;
    if (index === null) {
      const hint = this.scene.joints.length ? "Click a joint in the picture, or choose one above, to see its pin in its sleeve." : "This mechanism has no joints.";
      this.detail.replaceChildren(make("p", { class: "hint" }, hint));
      return;
    }
    const { contact } = this.scene.joints[index];
    const views = contact?.outline ? contact.views : [];
    const figures = views.map((view) => {
      const canvas = make("canvas", { class: view.kind, role: "img", "aria-label": view.title });
      this.sections.push([canvas, view]);
      return make("figure", {}, canvas, make("figcaption", {}, view.title));
    });
    const scale = views.length ? make("p", { class: "scale" }, `Sizes are true; play, tilt and wear × ${plain(contact.factor)}.`) : null;
    const why = contact && !views.length ? make("p", { class: "hint" }, "The file does not say what this joint looks like.") : null;
    const none = contact ? null : make("p", { class: "hint" }, "This joint has no play.");
    this.facts = make("dl", {});
    this.detail.replaceChildren(...[make("div", { class: "sections" }, ...figures), scale, why, none, this.facts].filter(Boolean));
  }

  setFacts(rows) {
    if (this.rows !== rows.length) {
      this.rows = rows.length;
      this.facts.replaceChildren(...rows.flatMap(([word]) => [make("dt", {}, word), make("dd", {})]));
    }
    rows.forEach(([, value, colour], i) => {
      const cell = this.facts.children[2 * i + 1];
      if (cell.textContent !== value) cell.textContent = value;
      if (colour) cell.style.boxShadow = `inset 12px 0 0 ${colour}`;
      cell.classList.toggle("state", colour !== undefined);
    });
  }

  _time() {
    this.button = make("button", { class: "play", "aria-label": "Play", title: "Play or pause (space)", onclick: () => this.viewer.toggle() });
    this.scrub = make("input", { type: "range", min: 0, max: 10000, value: 0, class: "scrub", "aria-label": "Time", oninput: () => this.viewer.setTime(this._scrubbed()) });
    this.speeds = make("select", { "aria-label": "Speed", onchange: () => { this.viewer.speed = Number(this.speeds.value); } });
    this.slider = make("input", { type: "range", min: 0, max: 1000, "aria-label": "Exaggeration of errors", oninput: () => this._exaggerate(this.slider.value / 1000) });
    this.factor = make("output", {});
    const large = make("label", { class: "factor" }, make("span", {}, "Error shown"), this.slider, this.factor);
    large.hidden = !this.scene.clearances;
    if (!this.scene.ideal) {
      this.slider.disabled = true;
      large.title = "The ideal mechanism is not known, see below.";
    }
    const controls = make("div", { class: "controls" }, this.button, this.scrub, make("label", { class: "speed" }, make("span", {}, "Speed"), this.speeds), large);
    this.setPlaying(false);
    return make("section", { class: "time", "aria-label": "Time" }, controls, make("div", { class: "rows" }, this.plots));
  }

  _scrubbed() {
    const { first, last } = this.viewer;
    return first + (this.scrub.value / 10000) * (last - first);
  }

  _exaggerate(share) {
    const { most } = this.scene.exaggeration;
    const factor = most ** share;
    this.viewer.setExaggeration(factor < 1.02 ? 1 : Number(factor.toPrecision(2)));
  }

  _foot() {
    const { notes } = this.scene;
    return make("footer", {}, ...notes.map((note) => make("p", {}, note)),
      make("p", {}, "Keys: space plays, ← → step, − + error, n p joints, g f t l show or hide, r first view, ? all keys. ", this.scene.software));
  }

  _help() {
    const rows = KEYS.flatMap(([key, what]) => [make("dt", {}, key), make("dd", {}, what)]);
    this.help = make("dialog", { "aria-label": "Keys" }, make("h2", {}, "Keys"), make("dl", {}, ...rows),
      make("p", {}, "Plots: click or drag to go to an instant, wheel to widen a part of the time, double click for all of it. Picture: drag, wheel, two fingers."),
      make("button", { onclick: () => this.help.close() }, "Close"));
    return this.help;
  }

  setSpeeds(chosen) {
    const every = [...new Set([...SPEEDS, chosen])].sort((a, b) => a - b);
    this.speeds.replaceChildren(...every.map((s) => make("option", { value: s }, s === 1 ? "real time" : s > 1 ? `${plain(s, 6)} × slower` : `${plain(1 / s)} × faster`)));
    this.speeds.value = String(chosen);
  }

  setPlaying(playing) {
    this.button.replaceChildren(icon(playing ? "M4 3h3v10H4zM9 3h3v10H9z" : "M4 2.5v11l9-5.5z"));
    this.button.setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  setFactor(factor, stage) {
    const { most } = this.scene.exaggeration;
    this.slider.value = most > 1 ? Math.round((1000 * Math.log(factor)) / Math.log(most)) : 0;
    this.factor.textContent = this.scene.ideal ? (factor === 1 ? "true scale" : `× ${plain(factor)}`) : "not known";
    const grid = `grid ${say(stage.gridStep, "m")}`;
    const error = factor === 1 ? "errors at true scale" : `errors × ${plain(factor)}, lengths true`;
    const force = this.scene.force.full > 0 ? `longest arrow ${say(this.scene.force.full, "N")}` : null;
    const chips = [this.scene.ideal ? error : null, grid, force].filter(Boolean);
    this.chips.replaceChildren(...chips.map((text, i) => make("span", { class: i === 0 && factor !== 1 && this.scene.ideal ? "strong" : "" }, text)));
  }

  show(time) {
    const { first, last } = this.viewer;
    const unit = last < 0.1 ? [1e3, "ms"] : [1, "s"];
    const digits = Math.min(Math.max(3 - Math.floor(Math.log10(unit[0] * last)), 0), 6);
    this.clock.textContent = `t = ${(unit[0] * time).toFixed(digits)} ${unit[1]}`;
    this.scrub.value = Math.round((10000 * (time - first)) / (last - first));
    this._label();
  }

  /** Names beside loose joints and points; one that would cover another is left out. */
  _label() {
    const { stage, selected } = this.viewer;
    const show = stage.shown.names !== false;
    const { joints, points } = this.scene;
    const entries = [...joints.map((j, i) => [j, i === selected, j.loose]), ...points.map((p) => [p, false, true])];
    if (!this.labels.length) {
      this.labels = entries.map(([{ name }]) => make("span", {}, name));
      this.names.replaceChildren(...this.labels);
    }
    const taken = [];
    const order = entries.map((_, i) => i).sort((a, b) => entries[b][1] - entries[a][1]);
    for (const i of order) {
      const [entry, chosen, wanted] = entries[i];
      const label = this.labels[i];
      const [x, y] = stage.onPage(stage.actual[entry.mark]);
      const box = [x + 12, y - 22, x + 14 + 7 * entry.name.length, y - 6];
      const free = taken.every((t) => box[0] > t[2] || box[2] < t[0] || box[1] > t[3] || box[3] < t[1]);
      const inside = box[2] < this.canvas.clientWidth && x > 0 && y > 20 && y < this.canvas.clientHeight;
      const there = show && free && inside && (chosen || wanted);
      label.hidden = !there;
      label.classList.toggle("chosen", chosen);
      if (!there) continue;
      taken.push(box);
      label.style.transform = `translate(${Math.round(box[0])}px, ${Math.round(box[1])}px)`;
    }
  }

  _listen() {
    const { viewer } = this;
    let from = null;
    this.canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; });
    this.canvas.addEventListener("pointerup", (event) => {
      if (from === null || Math.hypot(event.clientX - from[0], event.clientY - from[1]) > 5) return;
      const { left, top } = this.canvas.getBoundingClientRect();
      const joint = viewer.stage.jointAt(event.clientX - left, event.clientY - top, event.pointerType === "touch" ? 30 : 18);
      if (joint !== null) viewer.select(joint);
    });
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const ranged = event.target.matches?.("select, input") && ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End"].includes(event.key);
      const pressed = event.key === " " && event.target.matches?.("button, select");
      const act = this._keys(event.shiftKey)[event.key];
      if (!act || ranged || pressed) return;
      event.preventDefault();
      act();
    });
  }

  _keys(shift) {
    const { viewer } = this;
    const tenth = (viewer.last - viewer.first) / 10;
    const by = (sign) => (shift ? viewer.setTime(viewer.time + sign * tenth) : viewer.step(sign));
    const grow = (k) => this.scene.ideal && viewer.setExaggeration(Math.min(Math.max(Number((viewer.exaggeration * k).toPrecision(2)), 1), this.scene.exaggeration.most));
    const quick = (sign) => {
      const i = Math.min(Math.max(this.speeds.selectedIndex + sign, 0), this.speeds.length - 1);
      this.speeds.selectedIndex = i;
      viewer.speed = Number(this.speeds.value);
    };
    return {
      " ": () => viewer.toggle(), ArrowLeft: () => by(-1), ArrowRight: () => by(1), Home: () => viewer.setTime(viewer.first), End: () => viewer.setTime(viewer.last),
      ",": () => quick(1), ".": () => quick(-1), "-": () => grow(0.8), "+": () => grow(1.25), "=": () => grow(1.25), 1: () => grow(0),
      n: () => viewer.next(1), p: () => viewer.next(-1), Escape: () => (this.help.open ? this.help.close() : viewer.select(null)),
      g: () => this._toggle("ghost"), f: () => this._toggle("forces"), t: () => this._toggle("paths"), l: () => this._toggle("names"),
      r: () => viewer.fit(), "?": () => (this.help.open ? this.help.close() : this.help.showModal()),
    };
  }
}
