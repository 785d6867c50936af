// The page: reads its data, builds panels, controls, tables and plots, and keeps them in step.

import { KeyframeImage } from './keyframe_image.js';
import { follow } from './live.js';
import { countPlot, timingPlot, timingTop } from './plots.js';
import { Stage } from './stage.js';
import { Surface } from './surface.js';
import { colorBar, facts, notes, table } from './tables.js';

const find = (id) => document.getElementById(id);
const number = new Intl.NumberFormat('en');

/** Options after the # of the address: `#keyframe=10&view=keyframe&color=error&hide=segments,cameras`, or `#tab=planes`. */
function readHash() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

/** 256 colours in linear light, as the card blends them; three bytes each. */
function linearScale(scale) {
  const linear = (value) => {
    const share = value / 255;
    return 255 * (share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4);
  };
  const result = new Uint8Array(3 * 256);
  const last = scale.colors.length - 1;
  for (let i = 0; i < 256; i++) {
    const at = (i / 255) * last;
    const from = Math.min(Math.floor(at), last - 1);
    for (let channel = 0; channel < 3; channel++) {
      const [a, b] = [scale.colors[from][channel], scale.colors[from + 1][channel]];
      result[3 * i + channel] = Math.round(linear(a + (at - from) * (b - a)));
    }
  }
  return result;
}

class Page {
  constructor(data) {
    this.data = data;
    this.last = data.keyframes.length - 1;
    this.keyframe = this.last;
    /** The keyframe that was added last, while a run goes on. */
    this.newest = 0;
    this.plots = [];
    this.playing = null;
    this.#writeText();
    this.#buildTabs();
    this.#plot();
    const scale = data.error_scale ? linearScale(data.error_scale) : null;
    this.surfaces = data.surfaces.map((surface) => new Surface(surface, scale));
    this.#buildPanels();
    this.image = data.images.length > 0 ? new KeyframeImage(data.images, find('image')) : null;
    find('inset').hidden = !this.image;
    try {
      this.stage = new Stage(data, this.surfaces, find('canvas'), this.panels, find('area'));
    } catch (error) {
      this.stage = null;
      find('no-webgl').hidden = false;
      find('no-webgl').textContent = `The surfaces cannot be shown: ${error.message}. Tables and plots are below.`;
    }
    this.#buildControls();
  }

  #writeText() {
    const { data } = this;
    document.title = `${data.title} · Linecarve`;
    find('title').textContent = data.title;
    find('subtitle').textContent = data.subtitle;
    find('facts').replaceChildren();
    facts(find('facts'), data.facts);
    for (const one of data.tables) table(find('tables'), one);
    find('warnings-section').hidden = data.warnings.length === 0;
    notes(find('warnings'), data.warnings);
    find('generator').textContent = data.generator;
  }

  #buildTabs() {
    const { structure } = this.data;
    find('tabs').hidden = !structure;
    if (!structure) return;
    find('plan').src = `data:image/svg+xml,${encodeURIComponent(structure.plan)}`;
    for (const one of structure.tables) table(find('plane-tables'), one);
    for (const name of ['surface', 'planes']) {
      find(`tab-${name}`).addEventListener('click', () => this.setTab(name));
    }
  }

  #plot() {
    const parent = find('plots');
    const pick = (keyframe) => this.show(keyframe);
    const timed = this.data.surfaces.filter((surface) => surface.timing.stages.length > 0);
    const top = timed.length > 0 ? timingTop(timed) : 0;
    for (const surface of timed) this.plots.push(timingPlot(parent, surface, top, pick));
    for (const plot of this.data.count_plots) this.plots.push(countPlot(parent, plot.title, plot.series, pick));
  }

  #buildPanels() {
    const row = find('panels');
    this.panels = this.surfaces.map((surface) => {
      const panel = document.createElement('div');
      panel.className = 'panel';
      const label = document.createElement('div');
      label.className = 'panel-label';
      const name = document.createElement('strong');
      name.textContent = surface.label;
      const count = document.createElement('span');
      label.append(name, count);
      panel.append(label);
      row.append(panel);
      surface.countLabel = count;
      return panel;
    });
  }

  #buildControls() {
    const slider = find('slider');
    slider.max = this.last;
    // A run that goes on has its last state only.
    for (const control of [slider, find('play')]) control.hidden = Boolean(this.data.live);
    slider.addEventListener('input', () => this.show(slider.valueAsNumber));
    find('play').addEventListener('click', () => this.togglePlay());
    document.addEventListener('keydown', (event) => {
      if (event.target instanceof HTMLInputElement && event.target.type !== 'checkbox') return;
      const step = { ArrowRight: 1, ArrowLeft: -1, PageDown: 10, PageUp: -10 }[event.key];
      if (!step) return;
      event.preventDefault();
      this.show(this.keyframe + step);
    });
    for (const name of ['outside', 'keyframe']) {
      find(`view-${name}`).addEventListener('click', () => this.setView(name));
    }
    const hasErrors = this.surfaces.some((surface) => surface.errors);
    find('color-error-label').hidden = !hasErrors;
    find('color-error').addEventListener('change', (event) => this.setColoring(event.target.checked ? 'error' : 'clay'));
    find('color-texture-label').hidden = !this.surfaces.some((surface) => surface.textured);
    find('color-texture').addEventListener('change', (event) => this.setColoring(event.target.checked ? 'texture' : 'clay'));
    for (const surface of this.surfaces) surface.onChanged = () => this.stage?.draw();
    for (const box of document.querySelectorAll('input[data-layer]')) {
      const known = box.dataset.layer === 'cameras' || box.dataset.layer === 'wire'
        || this.surfaces.some((surface) => surface.layers[box.dataset.layer]);
      box.parentElement.hidden = !known;
      box.addEventListener('change', () => this.setLayer(box.dataset.layer, box.checked));
    }
    find('inside').addEventListener('change', (event) => this.setInside(event.target.checked));
    if (this.stage) {
      this.stage.onMoved = () => {
        this.follows = false;
        find('view-keyframe').classList.remove('active');
        find('view-outside').classList.remove('active');
      };
    }
  }

  /** Goes to a keyframe: surfaces, cameras, image and marks. */
  show(keyframe) {
    // A session has no keyframe at first.
    if (this.last < 0) return;
    // A run that goes on has its last state only.
    const shown = this.data.live ? this.newest : keyframe;
    this.keyframe = Math.min(Math.max(Math.round(shown), 0), this.last);
    find('slider').value = this.keyframe;
    const { name } = this.data.keyframes[this.keyframe];
    find('keyframe-label').textContent = `keyframe ${this.keyframe + 1} of ${this.last + 1} · frame ${name}`;
    if (this.stage) {
      if (this.follows) this.stage.viewKeyframe(this.keyframe);
      this.stage.show(this.keyframe);
    } else {
      for (const surface of this.surfaces) surface.show(this.keyframe);
    }
    for (const surface of this.surfaces) {
      surface.countLabel.textContent =
        `${number.format(surface.shownVertices)} vertices, ${number.format(surface.shown)} triangles`;
    }
    this.image?.show(this.keyframe);
    for (const plot of this.plots) plot.show(this.keyframe);
  }

  /** Takes the state of a run that goes on. */
  refresh(state) {
    const { data } = this;
    const outside = JSON.stringify(data.outside);
    if (state.keyframes !== data.keyframes || state.scene !== this.scene) {
      this.scene = state.scene;
      Object.assign(data, state.scene, { keyframes: state.keyframes, surfaces: data.surfaces, images: [] });
      this.#writeText();
      this.last = data.keyframes.length - 1;
      this.stage?.placeCameras();
      const isOutside = find('view-outside').classList.contains('active');
      if (isOutside && JSON.stringify(data.outside) !== outside) this.stage?.viewOutside();
    }
    this.newest = state.current;
    for (const surface of this.surfaces) {
      surface.replace(state);
      for (const [index, set] of [...surface.data.lines, { name: 'points' }].entries()) {
        const box = document.querySelector(`input[data-layer="${set.name}"]`);
        box.parentElement.hidden = surface.elements[index].lives.count === 0;
      }
    }
    if (state.image && state.image !== this.liveImage) {
      this.liveImage = state.image;
      this.image = new KeyframeImage([state.image], find('image'));
      find('inset').hidden = false;
    }
    this.#replot(state);
    this.show(this.newest);
    find('subtitle').textContent = state.ended
      ? 'The run has ended.'
      : state.connected
        ? 'live'
        : 'No connection: trying again.';
  }

  /** Plots anew, at most once a second. */
  #replot(state) {
    const now = performance.now();
    if (state.rows.length === 0 || (now - this.plotted < 1000 && !state.ended)) return;
    this.plotted = now;
    find('plots').replaceChildren();
    this.plots = [];
    this.data.surfaces[0].timing = state.timing();
    const triangles = state.triangles();
    this.data.count_plots = triangles.some((count) => count > 0)
      ? [{ title: 'triangles of the surface', series: [{ name: 'surface', values: triangles }] }]
      : [];
    this.#plot();
  }

  setTab(name) {
    const tab = this.data.structure && name === 'planes' ? 'planes' : 'surface';
    for (const one of ['surface', 'planes']) find(`tab-${one}`).classList.toggle('active', one === tab);
    document.body.classList.toggle('planes', tab === 'planes');
  }

  setView(name) {
    this.follows = name === 'keyframe';
    for (const one of ['outside', 'keyframe']) find(`view-${one}`).classList.toggle('active', one === name);
    if (!this.stage) return;
    this.setInside(name === 'keyframe');
    if (this.follows) this.stage.viewKeyframe(this.keyframe);
    else this.stage.viewOutside();
  }

  /** Whether triangles are seen from behind. */
  setInside(visible) {
    find('inside').checked = visible;
    for (const surface of this.surfaces) surface.setBackFaces(visible);
    this.stage?.draw();
  }

  setColoring(coloring) {
    const possible = {
      error: Boolean(this.data.error_scale),
      texture: this.surfaces.some((surface) => surface.textured),
    };
    const asked = possible[coloring] ? coloring : 'clay';
    for (const name of ['error', 'texture']) find(`color-${name}`).checked = asked === name;
    for (const surface of this.surfaces) surface.setColoring(asked);
    find('color-bar').hidden = asked !== 'error';
    if (asked === 'error') colorBar(find('color-bar'), this.data.error_scale);
    this.stage?.draw();
  }

  setLayer(layer, visible) {
    for (const box of document.querySelectorAll(`input[data-layer="${layer}"]`)) box.checked = visible;
    for (const surface of this.surfaces) {
      if (layer === 'wire') surface.setWire(visible);
      else if (surface.layers[layer]) surface.layers[layer].visible = visible;
    }
    if (layer === 'cameras') for (const { cameras } of this.stage?.scenes ?? []) cameras.group.visible = visible;
    this.stage?.draw();
  }

  togglePlay() {
    if (this.playing) {
      clearInterval(this.playing);
      this.playing = null;
    } else {
      if (this.keyframe === this.last) this.show(0);
      const pause = Math.min(250, Math.max(40, 12000 / (this.last + 1)));
      this.playing = setInterval(() => {
        if (this.keyframe >= this.last) this.togglePlay();
        else this.show(this.keyframe + 1);
      }, pause);
    }
    find('play').textContent = this.playing ? 'Pause' : 'Play';
  }
}

/** Walks through the keyframes and notes what the page shows; a test reads it from the document. */
function selfTest(page, loadMs) {
  const result = { load_ms: loadMs, webgl: Boolean(page.stage), states: [] };
  const count = Math.min(page.last + 1, 200);
  const started = performance.now();
  for (let i = 0; i < count; i++) {
    page.show(count === 1 ? page.last : Math.round((i * page.last) / (count - 1)));
    if (i % Math.ceil(count / 5) === 0 || i === count - 1) {
      page.stage?.drawNow();
      result.states.push({
        keyframe: page.keyframe,
        triangles: page.surfaces.map((surface) => surface.shown),
        vertices: page.surfaces.map((surface) => surface.shownVertices),
        elements: page.surfaces.map((surface) => surface.elements.map((elements) => elements.shown)),
      });
    }
  }
  result.step_ms = (performance.now() - started) / count;
  page.show(page.last);
  result.drawn_share = page.stage ? page.stage.drawnShare() : null;
  result.textured = page.surfaces.map((surface) => Boolean(surface.textured));
  return result;
}

/** Builds the page as its address asks for it. */
function open(data, hash) {
  const page = new Page(data);
  if (data.surfaces.length === 1) document.body.classList.add('single');
  page.setTab(hash.tab);
  page.setView('outside');
  page.setLayer('segments', false);
  const asked = Number.parseInt(hash.keyframe, 10);
  page.show(Number.isFinite(asked) ? asked : page.last);
  if (hash.view) page.setView(hash.view === 'keyframe' ? 'keyframe' : 'outside');
  page.setColoring(hash.color ?? 'texture');
  for (const layer of (hash.show ?? '').split(',').filter(Boolean)) page.setLayer(layer, true);
  for (const layer of (hash.hide ?? '').split(',').filter(Boolean)) page.setLayer(layer, false);
  return page;
}

/** Follows the run that serves the page. */
function startLive(hash, errors) {
  let page = null;
  find('subtitle').textContent = 'The run begins.';
  follow((state) => {
    if (!state.scene) return;
    if (!page) {
      page = open(state.emptyPage(), hash);
      window.linecarve = page;
    }
    page.refresh(state);
    if ('selftest' in hash) noteLive(page, state, errors);
  });
}

/** What the page shows of a run that goes on, for a test to read from the document. */
function noteLive(page, state, errors) {
  let output = find('selftest');
  if (!output) {
    output = document.createElement('pre');
    output.id = 'selftest';
    document.body.append(output);
  }
  const [surface] = page.surfaces;
  output.textContent = JSON.stringify({
    errors,
    triangles: surface.shown,
    vertices: surface.shownVertices,
    elements: surface.elements.map((elements) => elements.shown),
    keyframe: page.keyframe,
    cameras: page.data.keyframes.length,
    image: !find('inset').hidden,
    plots: page.plots.length,
    ended: state.ended,
    drawn_share: page.stage ? page.stage.drawnShare() : null,
  });
}

function start() {
  const started = performance.now();
  const hash = readHash();
  const errors = [];
  if ('selftest' in hash) {
    window.addEventListener('error', (event) => errors.push(event.message));
    for (const kind of ['error', 'warn']) console[kind] = (...message) => errors.push(message.join(' '));
  }
  const data = JSON.parse(find('report-data').textContent);
  if (data.live) {
    startLive(hash, errors);
    return;
  }
  const page = open(data, hash);
  page.stage?.drawNow();
  const loadMs = performance.now() - started;
  if ('selftest' in hash) {
    const output = document.createElement('pre');
    output.id = 'selftest';
    try {
      const result = selfTest(page, loadMs);
      result.errors = errors;
      output.textContent = JSON.stringify(result);
    } catch (error) {
      output.textContent = JSON.stringify({ errors: [...errors, String(error)] });
    }
    document.body.append(output);
  }
  window.linecarve = page;
}

start();
