// Maps as pictures: classes of cells, coloured for the theme, at several sizes so that thin walls stay visible.

const DARKEST = 0.36;   // luminance that walls have at least in the dark theme, 0 to 1
const UNKNOWN = 0, FREE = 1, OCCUPIED = 2;

/** The picture of one map. */
export class Picture {
  constructor(info) {
    this.info = info;
    this.floors = [];
    this.walls = [];
  }

  async load(url) {
    const reply = await fetch(url);
    if (!reply.ok) throw new Error(await reply.text());
    const bitmap = await createImageBitmap(await reply.blob(), { colorSpaceConversion: 'none' });
    const { width, height } = bitmap;
    const canvas = surface(width, height);
    const context = canvas.getContext('2d', { willReadFrequently: true });
    context.drawImage(bitmap, 0, 0);
    const grey = new Uint32Array(context.getImageData(0, 0, width, height).data.buffer);
    const cells = new Uint8Array(width * height);
    for (let i = 0; i < cells.length; i++) {
      const level = grey[i] & 255;
      cells[i] = level > 190 ? OCCUPIED : level > 60 ? FREE : UNKNOWN;
    }
    this.cells = cells;
    this.width = width;
    this.height = height;
    this.sizes = [{ cells, width, height }];
    while (Math.max(this.sizes.at(-1).width, this.sizes.at(-1).height) > 64) this.sizes.push(halved(this.sizes.at(-1)));
  }

  /** Colours the picture: floor and walls as [r, g, b]. They are pictures of their own, because no map's floor
   *  shall hide another one's walls. */
  colour(floor, wall) {
    this.floors = this.sizes.map(size => painted(size, [0, pack(floor, 220), 0]));
    this.walls = this.sizes.map(size => painted(size, [0, 0, pack(wall, 255)]));
  }

  /** Whether something is known at a point of the map, map coordinates, or near it. */
  isKnownAt(gridPoint, reach) {
    const r = this.info.resolution;
    const n = Math.max(0, Math.min(6, Math.round(reach / r)));
    const col = Math.floor(gridPoint[0] / r), row = this.height - 1 - Math.floor(gridPoint[1] / r);
    for (let y = row - n; y <= row + n; y++) {
      for (let x = col - n; x <= col + n; x++) {
        if (x >= 0 && y >= 0 && x < this.width && y < this.height && this.cells[y * this.width + x]) return true;
      }
    }
    return false;
  }
}

function painted({ cells, width, height }, packed) {
  const canvas = surface(width, height);
  const context = canvas.getContext('2d');
  const image = context.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  for (let i = 0; i < cells.length; i++) pixels[i] = packed[cells[i]];
  context.putImageData(image, 0, 0);
  return canvas;
}

/** Half as large: a cell is occupied where any of the four is. */
function halved({ cells, width, height }) {
  const w = Math.ceil(width / 2), h = Math.ceil(height / 2);
  const out = new Uint8Array(w * h);
  for (let y = 0; y < height; y++) {
    const row = (y >> 1) * w;
    for (let x = 0; x < width; x++) {
      const c = cells[y * width + x], k = row + (x >> 1);
      if (c > out[k]) out[k] = c;
    }
  }
  return { cells: out, width: w, height: h };
}

/** A colour [r, g, b] as light as thin walls on a dark ground need it. It is made stronger first, so that little white
 *  is needed; what was lighter than another one stays so, by which alone some are told apart. */
export function lifted(colour) {
  const strong = colour.map(c => c * Math.sqrt(255 / Math.max(...colour, 1)));
  const luminance = ([r, g, b]) => 0.2126 * (r / 255) ** 2.2 + 0.7152 * (g / 255) ** 2.2 + 0.0722 * (b / 255) ** 2.2;
  const wanted = DARKEST + (1 - DARKEST) * luminance(colour);
  for (let white = 0; ; white += 0.01) {
    const mixed = strong.map(c => Math.round(c + white * (255 - c)));
    if (luminance(mixed) >= wanted || white >= 1) return mixed;
  }
}

export function surface(width, height) {
  const canvas = document.createElement('canvas');
  canvas.width = width;
  canvas.height = height;
  return canvas;
}

function pack([r, g, b], a) {
  return ((a << 24) | (b << 16) | (g << 8) | r) >>> 0;
}
