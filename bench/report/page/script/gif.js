/* An encoder of animated GIFs (GIF89a): one palette for all frames, LZW of 8 bits. */
function encodeGif(frames, width, height, milliseconds) {
  const palette = paletteOf(frames), nearest = nearestIn(palette), bytes = [];
  const word = (value) => [value & 255, value >> 8];
  const push = (...values) => { for (const value of values) bytes.push(value); };
  push(...[..."GIF89a"].map((c) => c.charCodeAt(0)), ...word(width), ...word(height), 0xf7, 0, 0);
  for (let k = 0; k < 256; k += 1) push(...(palette[k] || [0, 0, 0]));
  push(0x21, 0xff, 11, ...[..."NETSCAPE2.0"].map((c) => c.charCodeAt(0)), 3, 1, 0, 0, 0);
  frames.forEach((frame, k) => {
    const delay = k === frames.length - 1 ? 120 : Math.round(milliseconds / 10); // the end is shown longer
    push(0x21, 0xf9, 4, 4, ...word(delay), 0, 0);
    push(0x2c, 0, 0, 0, 0, ...word(width), ...word(height), 0, 8);
    const data = compress(frame, nearest);
    for (let at = 0; at < data.length; at += 255) {
      const block = data.slice(at, at + 255);
      push(block.length, ...block);
    }
    push(0);
  });
  push(0x3b);
  return new Uint8Array(bytes);
}

const coarse = (r, g, b) => ((r >> 3) << 10) | ((g >> 3) << 5) | (b >> 3);

/* The 256 most frequent colours, in steps of 8, each as the mean of the colours that it replaces. */
function paletteOf(frames) {
  const count = new Uint32Array(1 << 15), sums = new Float64Array(3 << 15);
  for (const frame of frames) {
    for (let k = 0; k < frame.length; k += 4) {
      const key = coarse(frame[k], frame[k + 1], frame[k + 2]);
      count[key] += 1;
      for (let i = 0; i < 3; i += 1) sums[3 * key + i] += frame[k + i];
    }
  }
  const keys = [...count.keys()].filter((key) => count[key]).sort((a, b) => count[b] - count[a]).slice(0, 256);
  return keys.map((key) => [0, 1, 2].map((i) => Math.round(sums[3 * key + i] / count[key])));
}

function nearestIn(palette) {
  const known = new Int16Array(1 << 15).fill(-1);
  return (r, g, b) => {
    const key = coarse(r, g, b);
    if (known[key] < 0) {
      let least = Infinity;
      palette.forEach((colour, k) => {
        const d = (colour[0] - r) ** 2 + (colour[1] - g) ** 2 + (colour[2] - b) ** 2;
        if (d < least) { least = d; known[key] = k; }
      });
    }
    return known[key];
  };
}

/* LZW with codes of 9 to 12 bits, the lowest bit first. */
function compress(frame, nearest) {
  const CLEAR = 256, END = 257, MOST = 4096;
  const out = [], table = new Int16Array(MOST * 256);
  let bits = 0, held = 0, size = 9, next = 258;
  const emit = (code) => {
    held |= code << bits;
    bits += size;
    while (bits >= 8) { out.push(held & 255); held >>>= 8; bits -= 8; }
  };
  const reset = () => { table.fill(-1); size = 9; next = 258; };
  reset();
  emit(CLEAR);
  let prefix = nearest(frame[0], frame[1], frame[2]);
  for (let k = 4; k < frame.length; k += 4) {
    const value = nearest(frame[k], frame[k + 1], frame[k + 2]), place = prefix * 256 + value;
    if (table[place] >= 0) { prefix = table[place]; continue; }
    emit(prefix);
    if (next < MOST) {
      table[place] = next;
      if (next === 1 << size && size < 12) size += 1;
      next += 1;
    } else {
      emit(CLEAR);
      reset();
    }
    prefix = value;
  }
  emit(prefix);
  emit(END);
  if (bits > 0) out.push(held & 255);
  return out;
}
