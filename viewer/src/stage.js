// The three-dimensional picture: the mechanism, its ideal ghost, forces, paths of points; camera and clicks.
import {
  Box3, Color, ConeGeometry, DirectionalLight, DoubleSide, GridHelper, Group, HemisphereLight, Mesh, MeshBasicMaterial,
  MeshLambertMaterial, MOUSE, OrthographicCamera, Scene, SphereGeometry, TOUCH, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { Line2 } from "three/addons/lines/Line2.js";
import { LineGeometry } from "three/addons/lines/LineGeometry.js";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { BODIES, COLOURS, roundDown } from "./numbers.js";
import { joint, ROD, SHAPES, span } from "./shapes.js";

// Most points of a drawn path; seconds of a frame above which fewer pixels are drawn while it plays, and how few.
const [FINE, SLOW, COARSE] = [500, 0.07, 0.6];
const [ELEVATION, AZIMUTH] = [22, -58].map((degrees) => (degrees * Math.PI) / 180);

export class Stage {
  constructor(canvas, { scene, track, clocks }) {
    Object.assign(this, { canvas, data: scene, track, clocks, factor: scene.exaggeration.start, selected: null, share: 1, pace: 0 });
    this.shown = { ghost: true, forces: true, paths: true };
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: false });
    this.scene = new Scene();
    this.scene.background = new Color("#F7F9FB");
    this.camera = new OrthographicCamera();
    this.camera.up.set(0, scene.plane ? 1 : 0, scene.plane ? 0 : 1);
    this.ideal = scene.marks.map(() => new Vector3());
    this.actual = scene.marks.map(() => new Vector3());
    this.tracks = scene.marks.map((mark) => [track(mark.ideal), track(mark.error)]);
    this._light();
    this._controls();
    this._build();
    this.fit();
  }

  /** Where marks are at a time: on the ideal mechanism, and displaced by the error times the factor. */
  place(time) {
    this.where = this.clocks.time.find(time);
    const error = [];
    this.tracks.forEach(([ideal, away], i) => {
      const [x, y, z = 0] = ideal.at(this.where);
      this.ideal[i].set(x, y, z);
      this.actual[i].set(x, y, z);
      if (away) {
        const [dx, dy, dz = 0] = away.at(this.where, error);
        this.actual[i].add(new Vector3(dx, dy, dz).multiplyScalar(this.factor));
      }
    });
  }

  show(time) {
    this.place(time);
    const state = { where: this.where, factor: this.factor };
    this.parts.forEach((part) => part.update(part.place, state));
    this._arrows();
    this.markers.forEach(([ball, mark]) => ball.position.copy(this._front(this.actual[mark])));
    this.ghost.visible = this.shown.ghost && this.data.ideal;
    this.paths.visible = this.shown.paths;
    this.arrows.visible = this.shown.forces;
    this.halo.visible = this.selected !== null;
    if (this.selected !== null) {
      this.halo.position.copy(this._front(this.actual[this.data.joints[this.selected].mark]));
      this.halo.quaternion.copy(this.camera.quaternion);
    }
    this.renderer.render(this.scene, this.camera);
  }

  setFactor(factor) {
    this.factor = factor;
    this._tracePaths();
  }

  /** The joint nearest to a place on the page, within a finger's breadth; `null`: none. */
  jointAt(x, y, reach) {
    let [best, least] = [null, reach];
    this.data.joints.forEach((_, i) => {
      const [px, py] = this.onPage(this.actual[this.data.joints[i].mark]);
      const far = Math.hypot(px - x, py - y) - (this.data.joints[i].loose ? 4 : 0);
      if (far < least) [best, least] = [i, far];
    });
    return best;
  }

  /** Where a place is on the canvas [px]. */
  onPage(place) {
    const { x, y } = place.clone().project(this.camera);
    return [((x + 1) / 2) * this.canvas.clientWidth, ((1 - y) / 2) * this.canvas.clientHeight];
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!(width > 0 && height > 0)) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2) * this.share);
    this.renderer.setSize(width, height, false);
    const aspect = width / height;
    // Above and below there are words and buttons.
    const half = this.half * Math.max(height / (height - (width < 560 ? 96 : 56)), this.aspect / aspect);
    Object.assign(this.camera, { left: -half * aspect, right: half * aspect, top: half, bottom: -half });
    this.camera.updateProjectionMatrix();
    [...this.lines.map((line) => line.material), ...this.wires].forEach((material) => material.resolution.set(width, height));
  }

  /** Fewer pixels where a computer draws slowly, by the length of a frame [s]; `null`: as many as there are. */
  adapt(length) {
    this.pace = length === null ? 0 : 0.7 * this.pace + 0.3 * length;
    const share = this.pace > SLOW ? COARSE : length === null ? 1 : this.share;
    if (share === this.share) return;
    this.share = share;
    this.resize();
  }

  /** Look at the whole motion from the default side. */
  fit() {
    const { plane, size } = this.data;
    const box = new Box3(new Vector3(...this.data.low), new Vector3(...this.data.high));
    box.expandByScalar(plane ? 0.09 * size : 0.06 * size);
    if (!plane) box.min.z = Math.min(box.min.z, this.floor);
    const middle = box.getCenter(new Vector3());
    const ahead = plane ? new Vector3(0, 0, 1) : new Vector3(
      Math.cos(AZIMUTH) * Math.cos(ELEVATION), Math.sin(AZIMUTH) * Math.cos(ELEVATION), Math.sin(ELEVATION));
    this.camera.position.copy(middle).addScaledVector(ahead, 20 * size);
    this.controls.target.copy(middle);
    this.camera.zoom = 1;
    this.camera.lookAt(middle);
    this.camera.updateMatrixWorld();
    const seen = new Box3();
    for (let i = 0; i < 8; i += 1) {
      const corner = new Vector3(...["x", "y", "z"].map((axis, k) => (i & (1 << k) ? box.max : box.min)[axis]));
      seen.expandByPoint(corner.applyMatrix4(this.camera.matrixWorldInverse));
    }
    const extent = seen.getSize(new Vector3());
    [this.half, this.aspect] = [extent.y / 2, extent.x / extent.y];
    this.camera.near = 0.1 * size;
    this.camera.far = 60 * size;
    this.resize();
    this.controls.update();
  }

  _light() {
    this.scene.add(new HemisphereLight("#FFFFFF", "#B9C3CE", 2.1));
    const sun = new DirectionalLight("#FFFFFF", 1.5);
    sun.position.set(this.data.plane ? -0.4 : 0.8, this.data.plane ? 0.7 : -0.5, 1);
    this.scene.add(sun);
  }

  _controls() {
    this.controls = new OrbitControls(this.camera, this.canvas);
    Object.assign(this.controls, { enableDamping: false, zoomToCursor: true, minZoom: 0.2, maxZoom: 400 });
    if (this.data.plane) {
      this.controls.enableRotate = false;
      this.controls.mouseButtons = { LEFT: MOUSE.PAN, MIDDLE: MOUSE.DOLLY, RIGHT: MOUSE.PAN };
      this.controls.touches = { ONE: TOUCH.PAN, TWO: TOUCH.DOLLY_PAN };
    }
  }

  _build() {
    const { plane, size, low } = this.data;
    this.radius = (plane ? 0.013 : 0.02) * size;
    this.floor = plane ? null : low[2] - (low[2] > 0 && low[2] < 0.3 * size ? low[2] : 0.02 * size);
    this._grid();
    const ghostly = { transparent: true, opacity: 0.2, depthWrite: false, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 4 };
    const ghost = new MeshBasicMaterial({ color: "#3C4956", ...ghostly });
    [this.ghost, this.solid, this.paths, this.arrows] = [new Group(), new Group(), new Group(), new Group()];
    this.scene.add(this.solid, this.ghost, this.paths, this.arrows);
    this.parts = [];
    const shared = {
      radius: this.radius, size, floor: this.floor,
      ground: new MeshLambertMaterial({ color: "#C3CBD3", side: DoubleSide }), rail: new MeshLambertMaterial({ color: "#AEB8C2" }),
      wire: new LineMaterial({ color: "#5B6875", linewidth: 2.2 }),
    };
    this.wires = [shared.wire];
    this.data.parts.forEach((part) => {
      const colour = part.colour === undefined ? "#9AA5B0" : BODIES[part.colour % BODIES.length];
      const material = new MeshLambertMaterial({ color: colour, side: part.kind === "mesh" ? DoubleSide : 0 });
      const plate = new MeshBasicMaterial({ color: colour, transparent: true, opacity: 0.28, side: DoubleSide, depthWrite: false });
      const layer = plane && part.kind === "body" ? (part.colour + 1) * 0.4 * this.radius : 0;
      this._add(this.solid, part, { ...shared, material, plate }, this.actual, 1, layer);
      if (part.kind === "body" && this.data.ideal) {
        this._add(this.ghost, part, { ...shared, material: ghost, plate: ghost }, this.ideal, 0, layer);
      } else if (part.kind === "mesh" && part.shift !== null) {
        this._add(this.ghost, part, { ...shared, material: ghost }, this.ideal, 0, 0);
      }
    });
    const style = {
      radius: (plane ? 1.25 : 1.3) * this.radius, plane, pin: new MeshLambertMaterial({ color: "#FFFFFF" }),
      sleeve: new MeshLambertMaterial({ color: COLOURS.vermillion, transparent: !plane, opacity: plane ? 1 : 0.75, depthWrite: plane }),
    };
    const firm = new MeshLambertMaterial({ color: "#DDE3E9" });
    const top = plane ? (BODIES.length + 2) * this.radius : 0;
    this.data.joints.forEach((entry) => {
      const scale = entry.loose ? 1 : 0.8;
      const shape = joint(entry, { ...style, radius: scale * style.radius, pin: entry.loose ? style.pin : firm });
      shape.object.position.z = top;
      this.solid.add(shape.object);
      this.parts.push({ ...shape, place: (mark) => this.actual[mark] });
    });
    this._pointers();
  }

  _add(group, part, style, places, factor, layer) {
    const shape = SHAPES[part.kind](part, style, this.track);
    const holder = new Group().add(shape.object);
    holder.position.z = layer;
    group.add(holder);
    const update = factor === 0 ? (place, state) => shape.update(place, { ...state, factor: 0 }) : shape.update;
    this.parts.push({ update, place: (mark) => places[mark] });
  }

  _grid() {
    const { plane, size } = this.data;
    this.gridStep = roundDown(size / 4);
    const count = 2 * Math.ceil((plane ? 6 : 1.1) * size / this.gridStep);
    const grid = new GridHelper(count * this.gridStep, count, "#DDE3EA", "#E6EBF0");
    if (plane) grid.rotation.x = Math.PI / 2;
    else grid.rotation.x = Math.PI / 2;
    const middle = [0, 1].map((k) => Math.round((this.data.low[k] + this.data.high[k]) / 2 / this.gridStep) * this.gridStep);
    grid.position.set(middle[0], middle[1], plane ? -2 * size : this.floor);
    this.scene.add(grid);
  }

  /** Paths of points, forces, and the ring around the chosen joint. */
  _pointers() {
    const { points, joints } = this.data;
    this.lines = [];
    this.markers = [];
    this.traces = points.map(({ mark }) => {
      const [ideal, actual] = [[COLOURS.grey, 1.2], [COLOURS.vermillion, 2]].map(([color, linewidth]) => {
        const line = new Line2(new LineGeometry(), new LineMaterial({ color, linewidth, depthTest: !this.data.plane }));
        line.frustumCulled = false;
        this.lines.push(line);
        this.paths.add(line);
        return line;
      });
      const ball = new Mesh(new SphereGeometry(0.75 * this.radius, 16, 12), new MeshBasicMaterial({ color: COLOURS.vermillion }));
      this.paths.add(ball);
      this.markers.push([ball, mark]);
      return { mark, ideal, actual };
    });
    this._tracePaths();
    const material = new MeshBasicMaterial({ color: COLOURS.purple, depthTest: false, transparent: true });
    this.forces = joints.map((entry) => {
      const [shaft, head] = [new Mesh(ROD, material), new Mesh(new ConeGeometry(1, 1, 16), material)];
      [shaft, head].forEach((mesh) => { mesh.renderOrder = 5; });
      this.arrows.add(shaft, head);
      return { shaft, head, reaction: this.track(entry.reaction), mark: entry.mark };
    });
    const ring = new LineGeometry();
    const around = Array.from({ length: 65 }, (_, i) => (i * Math.PI) / 32);
    ring.setPositions(around.flatMap((angle) => [Math.cos(angle), Math.sin(angle), 0]));
    this.halo = new Line2(ring, new LineMaterial({ color: COLOURS.ink, linewidth: 2.2, depthTest: false, transparent: true }));
    this.halo.scale.setScalar(3.1 * this.radius);
    this.halo.renderOrder = 6;
    this.lines.push(this.halo);
    this.scene.add(this.halo);
  }

  _tracePaths() {
    const depth = this.data.plane ? (BODIES.length + 3) * this.radius : 0;
    const { times } = this.clocks.time;
    for (const { mark, ideal, actual } of this.traces) {
      const [track, away] = this.tracks[mark];
      const [first, second] = [[], []];
      const every = Math.max(1, Math.ceil(times.length / FINE));
      for (let k = 0; k < times.length - 1 + every; k += every) {
        const i = Math.min(k, times.length - 1);
        const at = [0, 1, 2].map((axis) => (axis < track.width ? track.get(i, axis) : depth));
        first.push(...at);
        second.push(...at.map((x, axis) => x + (away && axis < away.width ? this.factor * away.get(i, axis) : 0)));
      }
      for (const [line, places] of [[ideal, first], [actual, second]]) {
        line.geometry.dispose();
        line.geometry = new LineGeometry();
        line.geometry.setPositions(places);
      }
      ideal.visible = away !== null;
    }
  }

  _arrows() {
    const { full } = this.data.force;
    const longest = 0.22 * this.data.size;
    for (const { shaft, head, reaction, mark } of this.forces) {
      const [x, y, z = 0] = reaction ? reaction.at(this.where) : [0, 0, 0];
      const force = Math.hypot(x, y, z);
      const length = longest * Math.min(force / full, 1);
      const there = force > 0 && length > 0.15 * this.radius;
      shaft.visible = head.visible = there;
      if (!there) continue;
      const from = this._front(this.actual[mark]);
      const ahead = new Vector3(x, y, z).multiplyScalar(1 / force);
      const tip = Math.min(length, 2.2 * this.radius);
      const neck = from.clone().addScaledVector(ahead, length - tip);
      span(shaft, from, neck, 0.28 * this.radius);
      span(head, neck, from.clone().addScaledVector(ahead, length), 0.36 * tip);
    }
  }

  /** The same place before everything else, where the mechanism is plane. */
  _front(place) {
    return this.data.plane ? new Vector3(place.x, place.y, (BODIES.length + 4) * this.radius) : place;
  }
}
