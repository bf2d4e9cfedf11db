// Objects of the object map, and one of them in detail.
import { $, Problem, ask, coalesced, element, facts, get, number } from "./api.js";

const MOST_VIEWS = 3;

export class Objects {
  /** `onList(objects)` receives every new list, `onChoose(object)` the selected one, or null. */
  constructor(onList, onChoose) {
    this.onList = onList;
    this.onChoose = onChoose;
    this.objects = [];
    this.stored = []; // of a stored map in which the robot has not found its place
    this.chosen = null;
    this.shown = "";
    this.pictured = null;
    this.load = coalesced(() => this.fetch());
    $("object-close").addEventListener("click", () => this.choose(null));
  }

  async fetch() {
    const { objects, stored } = await ask("/objects");
    this.stored = stored;
    this.objects = objects.sort((a, b) => (b.score ?? 0) - (a.score ?? 0));
    this.onList(this.objects);
    this.draw();
  }

  choose(id) {
    const before = this.chosen;
    this.chosen = id === before ? null : id;
    this.onChoose(this.objects.find((object) => object.id === this.chosen) ?? null);
    this.draw();
    if (this.chosen === null) rowButton(before)?.focus();
  }

  draw() {
    const focused = document.activeElement?.closest("#objects button")?.dataset.id;
    const head = ["class", "Ψ", "views", "centre (m)"].map((textContent) =>
      element("th", { textContent, scope: "col" }),
    );
    const rows = this.objects.map((object) => {
      const button = element("button", { type: "button", className: "link", textContent: object.class });
      button.dataset.id = object.id;
      button.setAttribute("aria-expanded", object.id === this.chosen);
      button.setAttribute("aria-controls", "object");
      button.addEventListener("click", () => this.choose(object.id));
      const rest = [number(object.score), object.views, place(object.center_m, 1)];
      return element(
        "tr",
        { className: object.id === this.chosen ? "chosen" : "" },
        element("td", {}, button),
        ...rest.map((textContent) => element("td", { textContent })),
      );
    });
    rows.push(...this.stored.map(storedRow));
    $("objects").replaceChildren(
      element("thead", {}, element("tr", {}, ...head)),
      element("tbody", {}, ...rows),
    );
    $("objects").hidden = !rows.length;
    $("objects-empty").hidden = rows.length > 0;
    if (focused) rowButton(focused)?.focus();
    this.drawOne();
  }

  /** Shows the rendered view and history; requests them once per state of the object. */
  async showView(object) {
    const shown = `${object.id} ${object.views} ${object.score}`;
    if (shown === this.shown) return;
    if (object.id !== this.pictured) {
      $("object-views").replaceChildren();
      $("object-view").hidden = true;
      drawHistory([]);
    }
    [this.shown, this.pictured] = [shown, object.id];
    try {
      const { history } = await ask(`/objects/${object.id}/detail`);
      const response = await get(`/objects/${object.id}/view.png`);
      if (shown !== this.shown) return;
      drawHistory(history);
      const old = $("object-view").src;
      $("object-view").hidden = !response.ok;
      if (response.ok) $("object-view").src = URL.createObjectURL(await response.blob());
      $("object-view").alt = `what is modelled of ${object.class} ${object.id}`;
      if (old) URL.revokeObjectURL(old);
      const { views } = await ask(`/objects/${object.id}/views?limit=${MOST_VIEWS}`);
      if (shown === this.shown) drawViews(object, views);
    } catch (error) {
      if (shown === this.shown) this.shown = ""; // asked again with the next state
      if (!(error instanceof Problem || error instanceof TypeError)) throw error;
    }
  }

  drawOne() {
    const object = this.objects.find((one) => one.id === this.chosen);
    $("object").hidden = !object;
    if (!object) return;
    $("object-title").textContent = `${object.class} ${object.id}`;
    this.showView(object);
    const nats = object.image_text_nats;
    facts($("object-facts"), [
      ["score Ψ", number(object.score)],
      ["class score", number(object.class_score)],
      ["uncertainty", number(object.uncertainty)],
      ["views", object.views],
      ["detected in", object.detection_rate == null ? "" : `${Math.round(100 * object.detection_rate)} %`],
      ["image-text scores", nats ? `odds × ${Math.exp(nats).toPrecision(2)}` : ""],
      ["Gaussians", object.gaussians],
      ["centre", `${place(object.center_m)} m`],
      ["stored map", object.relocalisation ?? ""],
      ["size", `${place(object.size_m)} m`],
    ]);
    const likeliest = Object.entries(object.probabilities).sort((a, b) => (b[1] ?? 0) - (a[1] ?? 0));
    $("object-classes").replaceChildren(
      ...likeliest.slice(0, 6).map(([name, share]) => {
        const meter = element("meter", { min: 0, max: 1, value: share ?? 0 });
        meter.setAttribute("aria-label", `probability of ${name}`);
        return element(
          "li",
          {},
          element("span", { textContent: name }),
          meter,
          element("span", { textContent: number(share) }),
        );
      }),
    );
  }
}

/** Draws past views that show the object. */
function drawViews(object, views) {
  const said = ({ class: name, score }) => `${name ? "detected" : "fits"} ${number(score)}`;
  $("object-views").replaceChildren(
    ...views.map((view) => {
      const src = `data:image/jpeg;base64,${view.jpeg_base64}`;
      const alt = `a view of ${object.class} ${object.id}, ${said(view)}`;
      return element("li", {}, element("img", { src, alt, title: said(view) }));
    }),
  );
}

/** Draws the history of the score as a curve, 0 at the bottom and 1 at the top. */
function drawHistory(history) {
  const scores = history.map((moment) => moment.score ?? 0);
  const x = (i) => (scores.length < 2 ? 50 : (100 * i) / (scores.length - 1));
  const points = scores.map((score, i) => `${x(i)},${40 - 40 * Math.min(Math.max(score, 0), 1)}`);
  $("object-curve").setAttribute("points", points.join(" "));
  $("object-history").setAttribute(
    "aria-label",
    scores.length ? `score over ${scores.length} views: first ${number(scores[0])}, now ${number(scores.at(-1))}` : "no history",
  );
}

/** A row of an object of a stored map; it has no place to show before the robot has found its own. */
function storedRow(object) {
  const where = object.relocalisation === "tentative" ? place(object.center_m, 1) : "-";
  const rest = [number(object.score), object.views, `${where} (${object.relocalisation})`];
  return element(
    "tr",
    { className: "stored", title: "Of a stored map that is not in use. The robot does not drive there." },
    ...[object.class, ...rest].map((textContent) => element("td", { textContent })),
  );
}

const place = (point, digits = 2) => point.map((value) => number(value, digits)).join(" ");
const rowButton = (id) => $("objects").querySelector(`button[data-id="${id}"]`);
