// The image of the current keyframe with its segments over it.

import { bytes } from './decode.js';

/** Shows the image that belongs to a keyframe, or the last one before it. */
export class KeyframeImage {
  constructor(images, canvas) {
    this.images = images;
    this.canvas = canvas;
    this.cache = new Map();
    this.shown = -1;
  }

  show(keyframe) {
    let index = -1;
    while (index + 1 < this.images.length && this.images[index + 1].keyframe <= keyframe) index++;
    const image = this.images[index];
    if (!image || index === this.shown) return;
    this.shown = index;
    let picture = this.cache.get(index);
    if (!picture) {
      picture = new Image();
      picture.src = `data:image/jpeg;base64,${image.jpeg}`;
      this.cache.set(index, picture);
    }
    const draw = () => {
      if (this.shown === index) this.#draw(picture, image);
    };
    if (picture.complete) draw();
    else picture.addEventListener('load', draw, { once: true });
  }

  #draw(picture, image) {
    const { canvas } = this;
    const scale = 2;
    canvas.width = picture.naturalWidth * scale;
    canvas.height = picture.naturalHeight * scale;
    const context = canvas.getContext('2d');
    context.drawImage(picture, 0, 0, canvas.width, canvas.height);
    const raw = bytes(image.segments);
    const ends = new DataView(raw.buffer, raw.byteOffset, raw.byteLength);
    context.strokeStyle = '#ff7a2f';
    context.lineWidth = 2;
    context.beginPath();
    // Coordinates are in 32nds of a pixel of the stored image, whose first pixel has its centre at 0.
    const at = (offset) => (ends.getInt16(offset, true) / 32 + 0.5) * scale;
    for (let offset = 0; offset + 8 <= raw.length; offset += 8) {
      context.moveTo(at(offset), at(offset + 2));
      context.lineTo(at(offset + 4), at(offset + 6));
    }
    context.stroke();
  }
}
