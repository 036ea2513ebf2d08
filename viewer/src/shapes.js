// Shapes of the parts of a mechanism. Each has `update(place)`, where `place(mark)` is where a mark is now.
import {
  BoxGeometry, BufferGeometry, CylinderGeometry, Float32BufferAttribute, Group, Mesh, Quaternion,
  SphereGeometry, TorusGeometry, Vector3,
} from "three";
import { Line2 } from "three/addons/lines/Line2.js";
import { LineGeometry } from "three/addons/lines/LineGeometry.js";

const UP = new Vector3(0, 1, 0);
const ROD = new CylinderGeometry(1, 1, 1, 16, 1, true);
const BALL = new SphereGeometry(1, 16, 12);
const DISC = new CylinderGeometry(1, 1, 1, 28);
const BOX = new BoxGeometry(1, 1, 1);
const between = new Vector3();

/** A coil of length 1 along y, with straight ends. */
const COIL = Array.from({ length: 241 }, (_, i) => {
  const t = i / 240;
  const turn = Math.min(Math.max((t - 0.12) / 0.76, 0), 1) * 18 * Math.PI;
  const wide = t > 0.12 && t < 0.88 ? 1 : 0;
  return [wide * Math.cos(turn), t - 0.5, wide * Math.sin(turn)];
});

/** Puts a shape of length 1 along y between two places. */
export function span(mesh, a, b, radius) {
  between.subVectors(b, a);
  const length = between.length();
  mesh.visible = length > 1e-12;
  if (!mesh.visible) return;
  mesh.position.addVectors(a, b).multiplyScalar(0.5);
  mesh.quaternion.setFromUnitVectors(UP, between.multiplyScalar(1 / length));
  mesh.scale.set(radius, length, radius);
}

/** Capsules from a body's first mark to its others; where its marks span a plate, along the plate's edge. */
function body(part, style) {
  const { material, radius, plate } = style;
  const group = new Group();
  const { marks } = part;
  const pairs = part.plate ? marks.map((m, i) => [m, marks[(i + 1) % marks.length]]) : marks.slice(1).map((m) => [marks[0], m]);
  const rods = pairs.map(() => new Mesh(ROD, material));
  const balls = marks.map(() => new Mesh(BALL, material));
  balls.forEach((ball) => ball.scale.setScalar(radius));
  group.add(...rods, ...balls);
  let fan = null;
  if (part.plate && plate) {
    fan = new BufferGeometry();
    fan.setAttribute("position", new Float32BufferAttribute(new Float32Array(3 * marks.length), 3));
    fan.setIndex(marks.slice(2).flatMap((_, i) => [0, i + 1, i + 2]));
    const sheet = new Mesh(fan, plate);
    sheet.frustumCulled = false;
    group.add(sheet);
  }
  function update(place) {
    pairs.forEach(([a, b], i) => span(rods[i], place(a), place(b), radius));
    marks.forEach((mark, i) => balls[i].position.copy(place(mark)));
    if (fan) {
      marks.forEach((mark, i) => fan.attributes.position.setXYZ(i, ...place(mark).toArray()));
      fan.attributes.position.needsUpdate = true;
    }
  }
  return { object: group, update };
}

/** A body's own mesh, from a file, in the pose that moves with it. */
function mesh(part, style, track) {
  const group = new Group();
  for (const { positions, faces } of part.meshes) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new Float32BufferAttribute(Float32Array.from(track(positions).values), 3));
    geometry.setIndex(Array.from(track(faces).values));
    const flat = geometry.toNonIndexed();
    flat.computeVertexNormals();
    group.add(new Mesh(flat, style.material));
  }
  const [place, turn, shift, lean] = [part.position, part.rotation, part.shift, part.lean].map(track);
  const axis = new Vector3();
  const small = new Quaternion();
  function update(_, { where, factor }) {
    const [p, r] = [place.at(where), turn.at(where)];
    group.position.fromArray(p);
    group.quaternion.fromArray(r).normalize();
    if (!shift) return;
    group.position.addScaledVector(axis.fromArray(shift.at(where)), factor - 1);
    const angle = axis.fromArray(lean.at(where)).length() * (factor - 1);
    if (Math.abs(angle) > 1e-12) group.quaternion.premultiply(small.setFromAxisAngle(axis.normalize(), angle));
  }
  return { object: group, update };
}

function spring(part, style) {
  const coil = new Line2(new LineGeometry().setPositions(COIL.flat()), style.wire);
  coil.frustumCulled = false;
  const [a, b] = part.marks;
  return { object: coil, update: (place) => span(coil, place(a), place(b), 1.6 * style.radius) };
}

/** A block that slides along its direction, on a guide that stands still, or at the end of a rod from its parent. */
function slide(part, style, track) {
  const group = new Group();
  const [block, rail] = [new Mesh(BOX, style.material), new Mesh(part.reach ? BOX : ROD, style.rail)];
  group.add(block, rail);
  const [ahead, direction, turned] = [new Vector3(), track(part.direction), new Quaternion()];
  const { size } = style;
  block.scale.set(0.09 * size, 0.054 * size, 0.054 * size);
  const [low, high] = part.reach ?? [0, 0];
  rail.scale.set(high - low + 0.14 * size, 0.012 * size, 0.012 * size);
  function update(place, { where }) {
    const [x, y, z = 0] = direction.at(where);
    ahead.set(x, y, z).normalize();
    turned.setFromUnitVectors(new Vector3(1, 0, 0), ahead);
    block.position.copy(place(part.mark));
    block.quaternion.copy(turned);
    if (!part.reach) {
      span(rail, place(part.parent), block.position, 0.5 * style.radius);
      return;
    }
    rail.quaternion.copy(turned);
    rail.position.copy(place(part.parent)).addScaledVector(ahead, (low + high) / 2);
  }
  return { object: group, update };
}

/** What the ground carries: in the plane a triangle, in space a post on the floor. */
function support(part, style) {
  if (style.floor === null) {
    const { radius } = style;
    const shape = new BufferGeometry();
    const [w, h] = [2.6 * radius, 3.8 * radius];
    shape.setAttribute("position", new Float32BufferAttribute([0, 0, 0, -w, -h, 0, w, -h, 0], 3));
    shape.setIndex([0, 1, 2]);
    shape.computeVertexNormals();
    const group = new Group();
    const bar = new Mesh(BOX, style.rail);
    bar.scale.set(3.4 * w, 0.5 * radius, 0.5 * radius);
    bar.position.y = -h;
    group.add(new Mesh(shape, style.ground), bar);
    return { object: group, update: (place) => group.position.copy(place(part.mark)) };
  }
  const post = new Mesh(DISC, style.ground);
  const foot = new Mesh(DISC, style.ground);
  foot.rotation.x = Math.PI / 2;
  const group = new Group().add(post, foot);
  function update(place) {
    const top = place(part.mark);
    const low = new Vector3(top.x, top.y, Math.min(style.floor, top.z));
    span(post, low, top, 0.9 * style.radius);
    foot.position.copy(low);
    foot.scale.set(2.6 * style.radius, 0.5 * style.radius, 2.6 * style.radius);
  }
  return { object: group, update };
}

/** A pin in its sleeve: the ring is wider than the pin by the clearance, times the factor of the errors. */
export function joint(entry, style) {
  const { radius, plane } = style;
  const group = new Group();
  const pin = new Mesh(plane ? DISC : BALL, style.pin);
  group.add(pin);
  if (plane) {
    pin.rotation.x = Math.PI / 2;
    pin.scale.set(radius, 0.6 * radius, radius);
  } else pin.scale.setScalar(radius);
  let sleeve = null;
  function update(place, { factor }) {
    pin.position.copy(place(entry.mark));
    if (!entry.loose) return;
    const clearance = factor * (entry.clearance ?? 0);
    if (plane) {
      const inside = radius + clearance;
      if (!sleeve || sleeve.userData.inside !== inside) {
        if (sleeve) {
          group.remove(sleeve);
          sleeve.geometry.dispose();
        }
        sleeve = new Mesh(new TorusGeometry(inside + 0.22 * radius, 0.22 * radius, 8, 48), style.sleeve);
        sleeve.userData.inside = inside;
        group.add(sleeve);
      }
    } else {
      if (!sleeve) group.add((sleeve = new Mesh(BALL, style.sleeve)));
      sleeve.scale.setScalar(1.3 * radius + clearance);
    }
    sleeve.position.copy(place(entry.parent));
  }
  return { object: group, update };
}

/** The shapes by the kind of a part; a new kind of part is one more line. */
export const SHAPES = { body, mesh, spring, slide, support };
export { ROD };
