// The panels: one scene a surface, all drawn by one camera, so that what is seen left is seen right.

import {
  AmbientLight,
  Color,
  DirectionalLight,
  HemisphereLight,
  PerspectiveCamera,
  Quaternion,
  Scene,
  Vector3,
  WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { Cameras } from './cameras.js';

const BACKGROUND = new Color(0xf3f5f8);

/** Draws the surfaces side by side; draws only when something has changed. */
export class Stage {
  constructor(data, surfaces, canvas, panels, area) {
    this.data = data;
    this.surfaces = surfaces;
    this.canvas = canvas;
    this.panels = panels;
    this.area = area;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.up = new Vector3(...data.up);
    this.camera = new PerspectiveCamera(45, 1, 0.01, 1000);
    this.camera.up.copy(this.up);
    this.scenes = surfaces.map((surface) => this.#scene(surface));
    this.controls = new OrbitControls(this.camera, area);
    this.controls.zoomToCursor = true;
    this.controls.addEventListener('change', () => {
      this.#placeLamps();
      this.draw();
    });
    this.controls.addEventListener('start', () => this.onMoved?.());
    this.pending = false;
    new ResizeObserver(() => this.resize()).observe(area);
    this.resize();
  }

  #scene(surface) {
    const scene = new Scene();
    scene.background = BACKGROUND;
    const sky = new HemisphereLight(0xffffff, 0xb9b2a8, 1.5);
    sky.position.copy(this.up);
    const lamp = new DirectionalLight(0xfff4e6, 1.6);
    const head = new DirectionalLight(0xffffff, 0.6);
    const cameras = new Cameras(this.data.keyframes, this.data.camera, this.data.frustum);
    scene.add(new AmbientLight(0xffffff, 0.35), sky, lamp, lamp.target, head, head.target);
    scene.add(surface.group, cameras.group);
    return { scene, surface, lamp, head, cameras };
  }

  /** A lamp over the left shoulder and one at the eye. */
  #placeLamps() {
    const camera = this.camera;
    camera.updateMatrixWorld();
    const eye = camera.position;
    const right = new Vector3().setFromMatrixColumn(camera.matrixWorld, 0);
    const forward = new Vector3();
    camera.getWorldDirection(forward);
    for (const { lamp, head } of this.scenes) {
      head.position.copy(eye);
      head.target.position.copy(eye).add(forward);
      lamp.target.position.copy(eye);
      lamp.position.copy(eye).addScaledVector(this.up, 1.1).addScaledVector(right, -0.55).addScaledVector(forward, -0.6);
    }
  }

  resize() {
    const { width, height } = this.area.getBoundingClientRect();
    if (width === 0 || height === 0 || (width === this.width && height === this.height)) return;
    this.width = width;
    this.height = height;
    this.renderer.setSize(width, height, false);
    this.applyFieldOfView();
    // At once: another size empties the canvas, and the next picture of the screen may come before the next draw.
    this.drawNow();
  }

  /** Width over height of one panel. */
  get aspect() {
    const box = this.panels[0].getBoundingClientRect();
    return box.width / Math.max(box.height, 1);
  }

  /** Widens the field of view in narrow panels, so that what was to be seen is seen from side to side. */
  applyFieldOfView() {
    const wanted = this.lens ?? { vertical: 0.9, aspect: 4 / 3 };
    const half = Math.tan(wanted.vertical / 2);
    const narrow = Math.max(1, wanted.aspect / this.aspect);
    this.camera.aspect = this.aspect;
    this.camera.fov = (360 / Math.PI) * Math.atan(half * narrow);
    const reach = this.data.radius;
    this.camera.near = reach / 2000;
    this.camera.far = reach * 40;
    this.camera.updateProjectionMatrix();
  }

  /** Other keyframes in place of those before. */
  placeCameras() {
    for (const { cameras } of this.scenes) cameras.place(this.data.keyframes, this.data.camera, this.data.frustum);
    this.applyFieldOfView();
  }

  /** From outside and above, the near walls left out. */
  viewOutside() {
    const { eye, target, vertical, aspect } = this.data.outside;
    this.lens = { vertical, aspect };
    this.#showCameras(true);
    this.camera.up.copy(this.up);
    this.camera.position.set(...eye);
    this.controls.target.set(...target);
    this.controls.update();
    this.#settle();
  }

  /** What a keyframe saw, its roll included. */
  viewKeyframe(index) {
    const keyframe = this.data.keyframes[index];
    const lens = this.data.camera;
    // From inside, the frustums of its neighbours are in the way.
    this.#showCameras(false);
    this.lens = { vertical: 2 * Math.atan(lens.height / 2 / lens.fy), aspect: lens.width / lens.height };
    const rotation = new Quaternion(...keyframe.rotation);
    const forward = new Vector3(0, 0, 1).applyQuaternion(rotation);
    this.camera.position.set(...keyframe.position);
    this.controls.target.copy(this.camera.position).addScaledVector(forward, this.data.median_depth);
    // The camera of three.js looks along -z with y up, those of keyframes along z with y down.
    this.camera.quaternion.copy(rotation).multiply(new Quaternion(1, 0, 0, 0));
    this.#settle();
  }

  #showCameras(visible) {
    for (const { cameras } of this.scenes) cameras.inner.visible = visible;
  }

  #settle() {
    this.applyFieldOfView();
    this.#placeLamps();
    this.draw();
  }

  show(keyframe) {
    for (const { surface, cameras } of this.scenes) {
      surface.show(keyframe);
      cameras.show(keyframe);
    }
    this.draw();
  }

  /** Draws with the next picture of the screen. */
  draw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      this.drawNow();
    });
  }

  drawNow() {
    const whole = this.area.getBoundingClientRect();
    this.renderer.setScissorTest(true);
    this.panels.forEach((panel, index) => {
      const box = panel.getBoundingClientRect();
      const left = box.left - whole.left;
      const bottom = whole.bottom - box.bottom;
      this.renderer.setViewport(left, bottom, box.width, box.height);
      this.renderer.setScissor(left, bottom, box.width, box.height);
      this.renderer.render(this.scenes[index].scene, this.camera);
    });
  }

  /** Share of the pixels of the canvas that are not background. */
  drawnShare() {
    this.drawNow();
    const gl = this.renderer.getContext();
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
    const pixels = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const colors = new Map();
    for (let i = 0; i < pixels.length; i += 4) {
      const key = (pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2];
      colors.set(key, (colors.get(key) ?? 0) + 1);
    }
    return 1 - Math.max(...colors.values()) / (width * height);
  }
}
