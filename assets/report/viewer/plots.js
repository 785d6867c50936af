// Plots as SVG: stacked bars of milliseconds and curves of counts over keyframes.

const NS = 'http://www.w3.org/2000/svg';
const COLORS = ['#4e79a7', '#a0cbe8', '#59a14f', '#8cd17d', '#b6992d', '#f1ce63', '#e15759', '#ff9d9a', '#79706e', '#bab0ac', '#b07aa1', '#d4a6c8'];
/** Stages in the order of their colours, so that a stage has the same colour in every plot. */
const STAGES = ['load', 'depth', 'edges', 'fit', 'cluster', 'points', 'carve', 'surface', 'write', 'features'];
const WIDTH = 560;
const HEIGHT = 210;
const MARGIN = { left: 52, right: 10, top: 10, bottom: 34 };

function element(name, attributes, parent) {
  const node = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  parent?.append(node);
  return node;
}

/** The colour of a stage. */
function stageColor(name) {
  const index = STAGES.indexOf(name);
  return COLORS[(index < 0 ? STAGES.length : index) % COLORS.length];
}

/** A step of 1, 2 or 5 times a power of ten that divides `top` into about `parts`. */
function niceStep(top, parts) {
  const rough = top / parts;
  const power = 10 ** Math.floor(Math.log10(rough));
  const share = rough / power;
  return power * (share <= 1 ? 1 : share <= 2 ? 2 : share <= 5 ? 5 : 10);
}

const readable = (value) => (value >= 10000 ? `${+(value / 1000).toPrecision(3)}k` : `${+value.toPrecision(3)}`);

/** Frame, axes and the mark of the current keyframe. */
class Plot {
  constructor(parent, { title, unit, count, top, onPick }) {
    const figure = document.createElement('figure');
    const caption = document.createElement('figcaption');
    caption.textContent = title;
    figure.append(caption);
    parent.append(figure);
    this.figure = figure;
    this.svg = element('svg', { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: 'plot', role: 'img', 'aria-label': title }, figure);
    this.count = Math.max(count, 1);
    this.top = top > 0 ? top : 1;
    this.inner = { width: WIDTH - MARGIN.left - MARGIN.right, height: HEIGHT - MARGIN.top - MARGIN.bottom };
    this.#axes(unit);
    this.content = element('g', {}, this.svg);
    this.mark = element(
      'line',
      { y1: MARGIN.top, y2: MARGIN.top + this.inner.height, class: 'mark' },
      this.svg,
    );
    this.svg.addEventListener('click', (event) => {
      const box = this.svg.getBoundingClientRect();
      const x = ((event.clientX - box.left) / box.width) * WIDTH;
      const keyframe = Math.floor(((x - MARGIN.left) / this.inner.width) * this.count);
      onPick(Math.min(Math.max(keyframe, 0), this.count - 1));
    });
  }

  x(index) {
    return MARGIN.left + (index / this.count) * this.inner.width;
  }

  y(value) {
    return MARGIN.top + this.inner.height * (1 - value / this.top);
  }

  #axes(unit) {
    const { svg, inner } = this;
    const step = niceStep(this.top, 4);
    for (let value = 0; value <= this.top * 1.0001; value += step) {
      const y = this.y(value);
      element('line', { x1: MARGIN.left, x2: MARGIN.left + inner.width, y1: y, y2: y, class: value === 0 ? 'axis' : 'grid' }, svg);
      element('text', { x: MARGIN.left - 6, y: y + 4, class: 'tick right' }, svg).textContent = readable(value);
    }
    const every = Math.max(1, niceStep(this.count, 8));
    for (let index = 0; index < this.count; index += every) {
      element('text', { x: this.x(index + 0.5), y: HEIGHT - 18, class: 'tick middle' }, svg).textContent = index;
    }
    element('text', { x: MARGIN.left + inner.width / 2, y: HEIGHT - 3, class: 'tick middle' }, svg).textContent = 'keyframe';
    const label = element('text', { x: 0, y: 0, class: 'tick middle', transform: `translate(11 ${MARGIN.top + inner.height / 2}) rotate(-90)` }, svg);
    label.textContent = unit;
  }

  legend(entries) {
    const list = document.createElement('div');
    list.className = 'legend';
    for (const [name, color] of entries) {
      const item = document.createElement('span');
      const swatch = document.createElement('i');
      swatch.style.background = color;
      item.append(swatch, name);
      list.append(item);
    }
    this.figure.append(list);
  }

  show(keyframe) {
    const x = this.x(keyframe + 0.5);
    this.mark.setAttribute('x1', x);
    this.mark.setAttribute('x2', x);
  }
}

/** The value below which a share of the values lies: one slow keyframe must not flatten all the others. */
function quantile(values, share) {
  const sorted = values.filter(Number.isFinite).sort((a, b) => a - b);
  return sorted.length === 0 ? 0 : sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
}

/** Sums over the stages for each keyframe. */
export function totals(timing) {
  const count = timing.stages[0]?.milliseconds.length ?? 0;
  return Array.from({ length: count }, (_, i) =>
    timing.stages.reduce((sum, stage) => sum + (stage.milliseconds[i] ?? 0), 0),
  );
}

/** Milliseconds of each stage, stacked, over keyframes. */
export function timingPlot(parent, surface, top, onPick) {
  const { timing, label } = surface;
  const sums = totals(timing);
  const plot = new Plot(parent, {
    title: `${label}: time per keyframe and stage`,
    unit: 'milliseconds',
    count: sums.length,
    top,
    onPick,
  });
  const wide = Math.max(plot.inner.width / plot.count - (plot.count > 120 ? 0 : 1), 0.5);
  const base = sums.map(() => 0);
  const used = timing.stages.filter((stage) => stage.milliseconds.some((value) => value > 0));
  used.forEach((stage) => {
    let path = '';
    stage.milliseconds.forEach((value, i) => {
      if (!(value > 0)) return;
      const from = Math.min(base[i], plot.top);
      const to = Math.min(base[i] + value, plot.top);
      base[i] += value;
      const x = plot.x(i);
      path += `M${x.toFixed(2)} ${plot.y(from).toFixed(2)}h${wide.toFixed(2)}V${plot.y(to).toFixed(2)}h${(-wide).toFixed(2)}z`;
    });
    element('path', { d: path, fill: stageColor(stage.name) }, plot.content);
  });
  plot.legend(used.map((stage) => [stage.name, stageColor(stage.name)]));
  return plot;
}

/** The top of the axis that all timing plots share. */
export function timingTop(surfaces) {
  const all = surfaces.map((surface) => totals(surface.timing));
  return Math.max(...all.map((sums) => Math.min(Math.max(0, ...sums), 1.6 * quantile(sums, 0.9)))) * 1.04;
}

/** Curves over keyframes, of one count for each surface. */
export function countPlot(parent, title, series, onPick) {
  const count = Math.max(...series.map((one) => one.values.length));
  const top = Math.max(...series.flatMap((one) => one.values.filter(Number.isFinite)), 0) * 1.04;
  const plot = new Plot(parent, { title, unit: 'number', count, top, onPick });
  const colors = ['#c2571a', '#2060c8', '#3b7d3c', '#7a4fa3'];
  series.forEach((one, index) => {
    let path = '';
    one.values.forEach((value, i) => {
      if (!Number.isFinite(value)) return;
      path += `${path ? 'L' : 'M'}${plot.x(i + 0.5).toFixed(2)} ${plot.y(value).toFixed(2)}`;
    });
    element('path', { d: path, fill: 'none', stroke: colors[index % 4], 'stroke-width': 1.8 }, plot.content);
  });
  plot.legend(series.map((one, index) => [one.name, colors[index % 4]]));
  return plot;
}
