// Colours of the map from the page's style, and painting of the map's cells.

const NAMES = [
  "unknown", "free", "old", "occupied", "low", "middle", "high", "robot", "plan", "way",
  "frontier", "beyond", "object", "label",
];

/** Colours of the current theme, as text. */
export function palette() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(name).trim();
  const out = Object.fromEntries(NAMES.map((name) => [name, of(`--map-${name}`)]));
  return { ...out, text: of("--text"), muted: of("--muted"), card: of("--card") };
}

const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
const mix = (a, b, t) => a.map((value, i) => Math.round(value + (b[i] - value) * t));

/** 256 colours from low through middle to high. */
export function ramp(colors) {
  const [low, middle, high] = [colors.low, colors.middle, colors.high].map(rgb);
  return Array.from({ length: 256 }, (_, i) =>
    i < 128 ? mix(low, middle, i / 128) : mix(middle, high, (i - 128) / 127),
  );
}

/** Canvas that colours /v1/map/cells.png (red: state, green: explored, blue: value). */
export function paintCells(bitmap, colors, withValue) {
  const canvas = document.createElement("canvas");
  canvas.width = bitmap.width;
  canvas.height = bitmap.height;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  const image = context.getImageData(0, 0, canvas.width, canvas.height);
  const [free, old, occupied] = [colors.free, colors.old, colors.occupied].map(rgb);
  const values = ramp(colors);
  const data = image.data;
  for (let at = 0; at < data.length; at += 4) {
    const [state, explored, value] = [data[at], data[at + 1], data[at + 2]];
    if (state === 0) {
      data[at + 3] = 0;
      continue;
    }
    const color = state === 255 ? occupied : withValue && value ? values[value] : explored ? free : old;
    [data[at], data[at + 1], data[at + 2]] = color;
  }
  context.putImageData(image, 0, 0);
  return canvas;
}
