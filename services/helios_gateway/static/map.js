// Map: data, layers, pan and zoom. overlay.js draws over the cells.
import { $, Problem, ask, coalesced, element, get, number, words } from "./api.js";
import { drawOverlay } from "./overlay.js";
import { paintCells, palette, ramp } from "./palette.js";

const NO_LAYER = "occupancy";
const RETRY_MS = 5000; // from a failed load to the next try

export class MapView {
  constructor() {
    this.canvas = $("map");
    this.info = null;
    this.bitmap = null;
    this.frontiers = [];
    this.objects = [];
    this.plan = null;
    this.robot = null;
    this.description = null;
    this.decision = null;
    this.layer = NO_LAYER;
    this.layers = "";
    this.scale = 0; // pixels per metre; 0: no view yet
    this.center = [0, 0]; // world point in the middle of the canvas
    this.pointed = null; // world point to highlight
    this.held = false; // the user chose the view
    this.retry = null;
    this.load = coalesced(() => this.fetch());
    this.dirty = false;
    this.listen();
    this.drawLayers([]);
  }

  /** Loads the map; retries after a failure, because no change event may follow. */
  async fetch() {
    clearTimeout(this.retry);
    try {
      await this.update();
    } catch (error) {
      this.retry = setTimeout(() => this.load(), RETRY_MS);
      if (error instanceof Problem && error.status === 503) this.clear(); // there is no map
      if (error instanceof Problem && !this.info) $("map-empty").textContent = error.message;
      throw error;
    }
  }

  /** Shows that there is no map, as after a reset. */
  clear() {
    [this.info, this.bitmap, this.cells, this.frontiers] = [null, null, null, []];
    $("map-empty").hidden = false;
    $("map-facts").textContent = "";
    this.redraw();
  }

  async update() {
    const info = await ask("/map"); // 503 without a map
    const names = info.layers.map((one) => one.name);
    if (!names.includes(this.layer)) this.choose(NO_LAYER); // the layer ended with its search
    const layer = this.layer === NO_LAYER ? "" : `?layer=${encodeURIComponent(this.layer)}`;
    const response = await get(`/map/cells.png${layer}`);
    if (!response.ok) throw new Problem(`the cells of the map answered ${response.status}`);
    const options = { premultiplyAlpha: "none", colorSpaceConversion: "none" };
    this.bitmap = await createImageBitmap(await response.blob(), options);
    this.frontiers = (await ask("/map/frontiers")).frontiers;
    this.info = info;
    $("map-empty").hidden = true;
    $("map-facts").textContent = `explored ${number(info.explored_m2, 1)} m² · version ${info.version}`;
    this.drawLayers(names);
    this.paint();
    if (!this.held) this.fit();
    this.redraw();
  }

  drawLayers(names) {
    const wanted = names.length ? names : ["pick", "place"];
    if (this.layers === wanted.join()) return;
    this.layers = wanted.join();
    const buttons = [NO_LAYER, ...wanted].map((name) => {
      const text = name === NO_LAYER ? "Occupancy" : `Value: ${words(name)}`;
      const button = element("button", { type: "button", textContent: text });
      button.dataset.layer = name;
      button.addEventListener("click", () => {
        this.choose(name);
        this.load();
      });
      return button;
    });
    $("layers").replaceChildren(...buttons);
    this.choose(this.layer);
  }

  choose(name) {
    this.layer = name;
    for (const button of $("layers").children) {
      button.setAttribute("aria-pressed", button.dataset.layer === name);
    }
  }

  /** Colours the cells for the theme and layer. */
  paint() {
    const colors = palette();
    const layer = this.info?.layers.find((one) => one.name === this.layer);
    if (this.bitmap) this.cells = paintCells(this.bitmap, colors, Boolean(layer));
    $("scale").hidden = !layer;
    if (!layer) return;
    $("scale-max").textContent = number(layer.max_value);
    const context = $("ramp").getContext("2d");
    ramp(colors).forEach(([r, g, b], i) => {
      context.fillStyle = `rgb(${r} ${g} ${b})`;
      context.fillRect((i * 96) / 256, 0, 1, 8);
    });
  }

  /** [left, bottom, right, top] of the map, in the world, metres. */
  get bounds() {
    const { origin_m: [x, y], cell_m, width_cells, height_cells } = this.info;
    return [x, y, x + width_cells * cell_m, y + height_cells * cell_m];
  }

  fit() {
    if (!this.info) return;
    const [left, bottom, right, top] = this.bounds;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.scale = Math.min((width - 40) / (right - left || 1), (height - 40) / (top - bottom || 1), 300);
    this.center = [(left + right) / 2, (bottom + top) / 2];
    this.redraw();
  }

  /** Draws a ring around a world point, and centres the view on it if it is not visible. */
  point(at) {
    this.pointed = at;
    if (at && this.scale) {
      const [x, y] = this.toScreen(at);
      const { clientWidth: width, clientHeight: height } = this.canvas;
      if (x < 30 || y < 30 || x > width - 30 || y > height - 30) {
        this.center = at;
        this.held = true;
      }
    }
    this.redraw();
  }

  zoom(factor, at = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2]) {
    if (!this.scale) return;
    const before = this.toWorld(at);
    this.scale = Math.min(800, Math.max(4, this.scale * factor));
    const after = this.toWorld(at);
    this.center = [0, 1].map((i) => this.center[i] + before[i] - after[i]);
    this.held = true;
    this.redraw();
  }

  pan(dx, dy) {
    if (!this.scale) return;
    this.center = [this.center[0] - dx / this.scale, this.center[1] + dy / this.scale];
    this.held = true;
    this.redraw();
  }

  toScreen([x, y]) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [
      width / 2 + (x - this.center[0]) * this.scale,
      height / 2 - (y - this.center[1]) * this.scale,
    ];
  }

  toWorld([px, py]) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [
      this.center[0] + (px - width / 2) / this.scale,
      this.center[1] - (py - height / 2) / this.scale,
    ];
  }

  redraw() {
    if (this.dirty) return;
    this.dirty = true;
    requestAnimationFrame(() => {
      this.dirty = false;
      this.draw();
    });
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    const context = this.canvas.getContext("2d");
    context.scale(ratio, ratio);
    if (!this.info || !this.scale || !this.cells) return;
    const [left, , , top] = this.bounds;
    const [x, y] = this.toScreen([left, top]);
    const cell = this.info.cell_m * this.scale;
    context.imageSmoothingEnabled = cell < 1;
    context.drawImage(this.cells, x, y, this.cells.width * cell, this.cells.height * cell);
    drawOverlay(context, this, palette());
  }

  listen() {
    const pointers = new Map();
    let apart = 0;
    const at = (event) => [event.offsetX, event.offsetY];
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, at(event));
      apart = 0;
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      const now = at(event);
      if (this.scale) {
        const [x, y] = this.toWorld(now);
        $("readout").textContent = `x ${number(x)} m   y ${number(y)} m`;
      }
      if (!before) return;
      pointers.set(event.pointerId, now);
      if (pointers.size === 1) this.pan(now[0] - before[0], now[1] - before[1]);
      if (pointers.size === 2) {
        const [a, b] = [...pointers.values()];
        const distance = Math.hypot(a[0] - b[0], a[1] - b[1]);
        if (apart) this.zoom(distance / apart, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
        apart = distance;
      }
    });
    for (const type of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(type, (event) => pointers.delete(event.pointerId));
    }
    this.canvas.addEventListener("pointerleave", () => ($("readout").textContent = ""));
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 500), at(event));
    }, { passive: false });
    const keys = {
      "+": () => this.zoom(1.25), "=": () => this.zoom(1.25), "-": () => this.zoom(0.8),
      0: () => this.refit(), ArrowLeft: () => this.pan(60, 0), ArrowRight: () => this.pan(-60, 0),
      ArrowUp: () => this.pan(0, 60), ArrowDown: () => this.pan(0, -60),
    };
    this.canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key]) return;
      event.preventDefault();
      keys[event.key]();
    });
    $("zoom-in").addEventListener("click", () => this.zoom(1.25));
    $("zoom-out").addEventListener("click", () => this.zoom(0.8));
    $("fit").addEventListener("click", () => this.refit());
    for (const what of ["objects", "frontiers", "trajectory", "path"]) {
      $(`show-${what}`).addEventListener("change", () => this.redraw());
    }
    new ResizeObserver(() => (this.held ? this.redraw() : this.fit())).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.paint();
      this.redraw();
    });
  }

  refit() {
    this.held = false;
    this.fit();
  }
}
