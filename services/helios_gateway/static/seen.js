// "Where was it seen?": objects of the queried name, and past views that match the query.
import { $, Problem, ask, element, number } from "./api.js";

export class Seen {
  /** `onPoint([x, y])` receives the place that the user selects; null if it has none. */
  constructor(onPoint) {
    this.onPoint = onPoint;
    $("seen").addEventListener("submit", (event) => {
      event.preventDefault();
      this.search($("seen-prompt").value);
    });
  }

  async search(prompt) {
    const button = $("seen").querySelector("button");
    button.disabled = true;
    $("seen-said").textContent = "Searching…";
    try {
      this.show(await ask(`/seen?limit=6&prompt=${encodeURIComponent(prompt)}`));
    } catch (error) {
      $("sights").replaceChildren();
      $("seen-said").textContent =
        error instanceof Problem ? error.message : "The gateway cannot be reached; try again.";
    } finally {
      button.disabled = false;
    }
  }

  show({ prompt, objects, stored, views, views_asked, views_note }) {
    const found = objects.map((object) =>
      this.sight(object.center_m, `${object.class} ${object.id}`, `in the map, score Ψ ${number(object.score)}`),
    );
    const waiting = stored.map((object) =>
      this.sight(object.center_m, object.class, `in a stored map, ${object.relocalisation}`),
    );
    const seen = views.map((view) =>
      view.class
        ? this.sight(view.center_m, view.class, `detected, ${number(view.score)}`, view.jpeg_base64)
        : this.sight(view.center_m, "past view", `fits ${number(view.score)}`, view.jpeg_base64),
    );
    $("sights").replaceChildren(...found, ...waiting, ...seen);
    const said = [];
    if (!objects.length && !stored.length) said.push(`The map has no object named in “${prompt}”.`);
    if (!views.length && views_asked) said.push(`None of ${views_asked} past views fits.`);
    if (views_note) said.push(`${views_note[0].toUpperCase()}${views_note.slice(1)}.`);
    $("seen-said").textContent = said.join(" ");
  }

  sight(place, name, how, jpeg) {
    const [x, y] = place;
    const where = x == null || y == null ? "no place yet" : `x ${number(x, 1)} m, y ${number(y, 1)} m`;
    const words = element(
      "span",
      {},
      element("strong", { textContent: name }),
      element("span", { textContent: how }),
      element("span", { className: "hint", textContent: where }),
    );
    const button = element("button", { type: "button" });
    if (jpeg) button.append(element("img", { src: `data:image/jpeg;base64,${jpeg}`, alt: "" }));
    button.append(words);
    button.addEventListener("click", () => this.onPoint(x == null || y == null ? null : [x, y]));
    return element("li", {}, button);
  }
}
