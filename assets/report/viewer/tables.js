// Tables, facts and the colour bar: everything on the page that is text.

function element(name, parent, text, className) {
  const node = document.createElement(name);
  if (text !== undefined) node.textContent = text;
  if (className) node.className = className;
  parent?.append(node);
  return node;
}

/** A table with a heading row; numbers come as text, ready to be read. */
export function table(parent, { title, columns, rows, note }) {
  const figure = element('figure', parent);
  if (title) element('figcaption', figure, title);
  const scroll = element('div', figure, undefined, 'scroll');
  const node = element('table', scroll);
  const head = element('tr', element('thead', node));
  for (const column of columns) element('th', head, column);
  const body = element('tbody', node);
  for (const row of rows) {
    const line = element('tr', body);
    row.forEach((cell, index) => element(index === 0 ? 'th' : 'td', line, cell));
  }
  if (note) element('p', figure, note, 'note');
}

/** Pairs of a name and a value. */
export function facts(parent, pairs) {
  const list = element('dl', parent, undefined, 'facts');
  for (const [name, value] of pairs) {
    element('dt', list, name);
    element('dd', list, value);
  }
}

/** Lines of text as a list. */
export function notes(parent, lines) {
  const list = element('ul', parent, undefined, 'notes');
  for (const line of lines) element('li', list, line);
}

/** The colours of distances, with ticks. */
export function colorBar(parent, scale) {
  parent.replaceChildren();
  element('span', parent, scale.label, 'bar-label');
  const bar = element('span', parent, undefined, 'bar');
  const stops = scale.colors.map(
    (color, index) => `rgb(${color.join(' ')}) ${((100 * index) / (scale.colors.length - 1)).toFixed(2)}%`,
  );
  element('span', bar, undefined, 'bar-colors').style.background = `linear-gradient(to right, ${stops.join(', ')})`;
  for (const [position, text] of scale.ticks) {
    element('span', bar, text, 'bar-tick').style.left = `${100 * position}%`;
  }
}
