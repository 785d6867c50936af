// The path of the camera and a frustum for every keyframe.

import { BufferAttribute, BufferGeometry, Group, Line, LineBasicMaterial, LineSegments, Quaternion, Vector3 } from 'three';

const PATH = 0x6b7683;
const FRUSTUM = 0x8a94a0;
const CURRENT = 0x0b7a4b;

/** Corners of a frustum in its camera (x right, y down, z forward), at depth `depth`. */
function frustumCorners(camera, depth) {
  const at = (x, y) =>
    new Vector3(((x - camera.cx) / camera.fx) * depth, ((y - camera.cy) / camera.fy) * depth, depth);
  const right = camera.width - 0.5;
  const bottom = camera.height - 0.5;
  return [at(-0.5, -0.5), at(right, -0.5), at(right, bottom), at(-0.5, bottom)];
}

/** Ends of the eight lines of a frustum, in the world. */
function frustumLines(keyframe, corners) {
  const rotation = new Quaternion(...keyframe.rotation);
  const center = new Vector3(...keyframe.position);
  const [a, b, c, d] = corners.map((corner) => corner.clone().applyQuaternion(rotation).add(center));
  return [center, a, center, b, center, c, center, d, a, b, b, c, c, d, d, a].flatMap((p) => [p.x, p.y, p.z]);
}

/** Path and frustums up to the current keyframe, the current one in a colour of its own. */
export class Cameras {
  constructor(keyframes, camera, size) {
    this.group = new Group();
    this.inner = new Group();
    this.group.add(this.inner);
    this.path = new Line(new BufferGeometry(), new LineBasicMaterial({ color: PATH }));
    this.frustums = new LineSegments(
      new BufferGeometry(),
      new LineBasicMaterial({ color: FRUSTUM, transparent: true, opacity: 0.45 }),
    );
    this.current = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: CURRENT }));
    this.place(keyframes, camera, size);
    for (const object of [this.path, this.frustums, this.current]) {
      object.frustumCulled = false;
      this.inner.add(object);
    }
  }

  /** Puts the cameras where they are. */
  place(keyframes, camera, size) {
    const corners = frustumCorners(camera, size);
    const path = new Float32Array(keyframes.flatMap((keyframe) => keyframe.position));
    const all = new Float32Array(keyframes.flatMap((keyframe) => frustumLines(keyframe, corners)));
    for (const [object, ends] of [[this.path, path], [this.frustums, all], [this.current, all]]) {
      object.geometry.dispose();
      object.geometry = new BufferGeometry();
      object.geometry.setAttribute('position', new BufferAttribute(ends, 3));
    }
  }

  show(keyframe) {
    this.path.geometry.setDrawRange(0, keyframe + 1);
    this.frustums.geometry.setDrawRange(0, 16 * keyframe);
    this.current.geometry.setDrawRange(16 * keyframe, 16);
  }
}
