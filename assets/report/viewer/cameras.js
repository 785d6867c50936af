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
    const path = new BufferGeometry();
    path.setAttribute(
      'position',
      new BufferAttribute(new Float32Array(keyframes.flatMap((keyframe) => keyframe.position)), 3),
    );
    this.path = new Line(path, new LineBasicMaterial({ color: PATH }));
    const corners = frustumCorners(camera, size);
    const all = new Float32Array(keyframes.flatMap((keyframe) => frustumLines(keyframe, corners)));
    const frustums = new BufferGeometry();
    frustums.setAttribute('position', new BufferAttribute(all, 3));
    this.frustums = new LineSegments(
      frustums,
      new LineBasicMaterial({ color: FRUSTUM, transparent: true, opacity: 0.45 }),
    );
    const current = new BufferGeometry();
    current.setAttribute('position', new BufferAttribute(all, 3));
    this.current = new LineSegments(current, new LineBasicMaterial({ color: CURRENT }));
    for (const object of [this.path, this.frustums, this.current]) {
      object.frustumCulled = false;
      this.inner.add(object);
    }
  }

  show(keyframe) {
    this.path.geometry.setDrawRange(0, keyframe + 1);
    this.frustums.geometry.setDrawRange(0, 16 * keyframe);
    this.current.geometry.setDrawRange(16 * keyframe, 16);
  }
}
