// One surface with its lines and points at any state of its history.

import {
  BackSide,
  BufferAttribute,
  BufferGeometry,
  DynamicDrawUsage,
  FrontSide,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  Points,
  PointsMaterial,
  SRGBColorSpace,
  TextureLoader,
} from 'three';
import { allAlive, bytes, lives, positions, triangles as decodeTriangles } from './decode.js';

const CLAY = 0xd9d2c5;
const INSIDE = 0x8f4f4b;

/** A list of elements of `size` floats that is filled anew for every state. */
class Buffer {
  constructor(name, size, geometry, Kind = Float32Array) {
    this.name = name;
    this.size = size;
    this.geometry = geometry;
    this.Kind = Kind;
    this.array = new Kind(0);
  }

  /** The array with room for `count` elements; a new one on the card only when the old one is too small. */
  reserve(count) {
    if (this.array.length < count * this.size) {
      this.array = new this.Kind(Math.ceil(count * 1.3) * this.size);
      const attribute = new BufferAttribute(this.array, this.size, this.Kind === Uint8Array);
      attribute.setUsage(DynamicDrawUsage);
      this.geometry.setAttribute(this.name, attribute);
    }
    return this.array;
  }

  changed(count) {
    const attribute = this.geometry.getAttribute(this.name);
    if (!attribute) return;
    attribute.clearUpdateRanges();
    attribute.addUpdateRange(0, count * this.size);
    attribute.needsUpdate = true;
  }
}

/** Lines or points of which those are shown that live at the current state. */
class LiveElements {
  /** `data` has the lives of the elements; `places` their points, `size` of them an element. */
  constructor(data, places, size, makeObject) {
    this.lives = lives(data);
    this.places = positions(places);
    this.size = size;
    this.geometry = new BufferGeometry();
    this.buffer = new Buffer('position', 3, this.geometry);
    this.object = makeObject(this.geometry);
    this.object.frustumCulled = false;
    this.shown = 0;
  }

  /** Other elements, which all live. */
  replace(places) {
    this.places = places;
    this.lives = allAlive(places.length / (3 * this.size));
  }

  show(state) {
    const { count, birth, death } = this.lives;
    const step = 3 * this.size;
    let alive = 0;
    for (let i = 0; i < count && birth[i] <= state; i++) alive += death[i] > state ? 1 : 0;
    const target = this.buffer.reserve(this.size * alive);
    let at = 0;
    for (let i = 0; i < count && birth[i] <= state; i++) {
      if (death[i] <= state) continue;
      for (let k = step * i; k < step * (i + 1); k++) target[at++] = this.places[k];
    }
    this.shown = alive;
    this.buffer.changed(this.size * alive);
    this.geometry.setDrawRange(0, this.size * alive);
  }
}

/** The final mesh with its texture; `onLoaded` is called once the image can be drawn. */
class TexturedMesh {
  constructor(data, onLoaded) {
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(positions(data.vertices), 3));
    geometry.setAttribute('uv', new BufferAttribute(new Uint16Array(bytes(data.coordinates).buffer), 2, true));
    geometry.setIndex(new BufferAttribute(new Uint32Array(bytes(data.triangles).buffer), 1));
    const map = new TextureLoader().load(`data:${data.media_type};base64,${data.image}`, () => {
      this.isLoaded = true;
      onLoaded();
    });
    // Coordinates count from the upper edge.
    map.flipY = false;
    map.colorSpace = SRGBColorSpace;
    const common = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
    this.front = new Mesh(geometry, new MeshBasicMaterial({ map, side: FrontSide, ...common }));
    this.back = new Mesh(geometry, new MeshLambertMaterial({ color: INSIDE, side: BackSide, flatShading: true, ...common }));
    this.isLoaded = false;
  }
}

/** A surface, its lines and points. */
export class Surface {
  constructor(data, scale) {
    this.data = data;
    this.name = data.name;
    this.label = data.label;
    this.positions = positions(data.vertices);
    this.triangles = decodeTriangles(data.triangles);
    this.errors = data.errors ? bytes(data.errors) : null;
    this.scale = scale;
    this.coloring = 'clay';
    this.state = -1;
    this.shown = 0;
    this.shownVertices = 0;
    this.group = new Group();
    this.#buildMesh();
    /** Called when the surface looks different without being asked to. */
    this.onChanged = () => {};
    if (data.texture) {
      this.textured = new TexturedMesh(data.texture, () => {
        this.#chooseMesh();
        this.onChanged();
      });
      for (const object of [this.textured.front, this.textured.back]) {
        object.frustumCulled = false;
        this.mesh.add(object);
      }
    }
    this.backFaces = true;
    this.#chooseMesh();
    this.layers = { surface: this.mesh };
    this.elements = data.lines.map((set) => {
      const material = new LineBasicMaterial({ color: set.color, transparent: true, opacity: 0.7 });
      return this.#add(set.name, new LiveElements(set, set.ends, 2, (g) => new LineSegments(g, material)));
    });
    if (data.points) {
      const material = new PointsMaterial({ color: data.points.color, size: 2.5, sizeAttenuation: false });
      const { points } = data;
      this.elements.push(this.#add('points', new LiveElements(points, points.places, 1, (g) => new Points(g, material))));
    }
  }

  #add(name, elements) {
    this.group.add(elements.object);
    this.layers[name] = elements.object;
    return elements;
  }

  #buildMesh() {
    this.geometry = new BufferGeometry();
    this.position = new Buffer('position', 3, this.geometry);
    this.color = new Buffer('color', 3, this.geometry, Uint8Array);
    const common = { flatShading: true, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
    this.front = new MeshLambertMaterial({ color: CLAY, side: FrontSide, ...common });
    this.back = new MeshLambertMaterial({ color: INSIDE, side: BackSide, ...common });
    this.mesh = new Group();
    this.frontMesh = new Mesh(this.geometry, this.front);
    this.backMesh = new Mesh(this.geometry, this.back);
    this.wireGeometry = new BufferGeometry();
    this.wirePosition = new Buffer('position', 3, this.wireGeometry);
    this.wire = new LineSegments(
      this.wireGeometry,
      new LineBasicMaterial({ color: 0x303438, transparent: true, opacity: 0.3 }),
    );
    this.wire.visible = false;
    for (const object of [this.frontMesh, this.backMesh, this.wire]) {
      object.frustumCulled = false;
      this.mesh.add(object);
    }
    this.group.add(this.mesh);
  }

  /** Another surface and other elements in place of those before: those of a run that goes on. */
  replace({ surface, lines, points }) {
    this.positions = surface.positions;
    this.triangles = { ...allAlive(surface.count), corners: surface.corners };
    this.data.states = [0];
    this.data.vertex_counts = [surface.vertexCount];
    this.data.lines.forEach((set, index) => this.elements[index].replace(lines[set.name]));
    this.elements[this.data.lines.length].replace(points);
    this.state = -1;
  }

  /** The last state that is not after a keyframe; -1 before the first. */
  stateAt(keyframe) {
    const states = this.data.states;
    let low = 0;
    let high = states.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (states[middle] <= keyframe) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  /** The mesh with the texture at the last state when it is asked for, else the carved one. */
  #chooseMesh() {
    const isLast = this.state === this.data.states.length - 1;
    this.showsTexture = Boolean(this.coloring === 'texture' && this.textured?.isLoaded && isLast);
    this.frontMesh.visible = !this.showsTexture;
    this.backMesh.visible = !this.showsTexture && this.backFaces;
    if (!this.textured) return;
    this.textured.front.visible = this.showsTexture;
    this.textured.back.visible = this.showsTexture && this.backFaces;
  }

  /** Clay, the texture (clay before the last state), or the distance to the ground truth. */
  setColoring(coloring) {
    if (coloring === this.coloring || (coloring === 'error' && !this.errors)) return;
    this.coloring = coloring;
    this.#chooseMesh();
    const colored = coloring === 'error';
    this.front.vertexColors = colored;
    this.front.color.set(colored ? 0xffffff : CLAY);
    this.front.needsUpdate = true;
    this.#fill();
  }

  setBackFaces(visible) {
    this.backFaces = visible;
    this.#chooseMesh();
  }

  setWire(visible) {
    if (visible === this.wire.visible) return;
    this.wire.visible = visible;
    if (visible) this.#fillWire();
  }

  /** Shows the surface as it was after a keyframe. */
  show(keyframe) {
    const state = this.stateAt(keyframe);
    if (state === this.state) return;
    this.state = state;
    this.#fill();
    this.#chooseMesh();
    for (const elements of this.elements) elements.show(state);
  }

  #fill() {
    const { count, corners, birth, death } = this.triangles;
    const state = this.state;
    let alive = 0;
    for (let i = 0; i < count && birth[i] <= state; i++) alive += death[i] > state ? 1 : 0;
    const position = this.position.reserve(3 * alive);
    const colored = this.coloring === 'error';
    const color = colored ? this.color.reserve(3 * alive) : null;
    let at = 0;
    let paint = 0;
    for (let i = 0; i < count && birth[i] <= state; i++) {
      if (death[i] <= state) continue;
      for (let k = 3 * i; k < 3 * i + 3; k++) {
        const from = 3 * corners[k];
        position[at++] = this.positions[from];
        position[at++] = this.positions[from + 1];
        position[at++] = this.positions[from + 2];
      }
      if (colored) {
        const shade = 3 * this.errors[i];
        for (let k = 0; k < 3; k++) {
          color[paint++] = this.scale[shade];
          color[paint++] = this.scale[shade + 1];
          color[paint++] = this.scale[shade + 2];
        }
      }
    }
    this.shown = alive;
    this.shownVertices = state < 0 ? 0 : this.data.vertex_counts[state];
    this.position.changed(3 * alive);
    if (colored) this.color.changed(3 * alive);
    this.geometry.setDrawRange(0, 3 * alive);
    if (this.wire.visible) this.#fillWire();
  }

  /** The edges of the triangles that are shown, two ends each; an edge that two triangles share is drawn twice. */
  #fillWire() {
    const corners = this.position.array;
    const target = this.wirePosition.reserve(6 * this.shown);
    let at = 0;
    for (let i = 0; i < this.shown; i++) {
      for (let edge = 0; edge < 3; edge++) {
        for (const corner of [edge, (edge + 1) % 3]) {
          const from = 9 * i + 3 * corner;
          target[at++] = corners[from];
          target[at++] = corners[from + 1];
          target[at++] = corners[from + 2];
        }
      }
    }
    this.wirePosition.changed(6 * this.shown);
    this.wireGeometry.setDrawRange(0, 6 * this.shown);
  }
}
