// Decisions: candidates, choice and reason.
import { $, ask, coalesced, element, number, words } from "./api.js";

const LAST = ["score", "total"]; // columns of the deciding terms come last
const SAME = ["score", "score_after_view"]; // terms that may equal the total
const MEANINGS = {
  class_score: "S: how probable its class is, over all views",
  uncertainty: "U: how little is known about that",
  score: "Ψ: class score less uncertainty; what is acted on",
  score_after_view: "Ψ′: the score that one more view could bring",
  information_gain: "how much looking there is expected to tell",
  value: "how well what is seen there fits what is sought",
  way_m: "how long the way there is; narrow stretches count more",
  unknown_m: "how much of the way nobody has seen yet",
  size_m: "how long the border to the unknown is",
  frontier_scale: "F₀: what frontiers count beside receptacles",
  distance_m: "how far away it is, in a straight line",
  in_hand: "how likely it was the sought thing when it was looked at in the hand",
  own_share: "how often its own name was given in the hand, among all names",
  probability: "how likely it is the sought thing",
  sides: "from how many sides it was seen in the hand",
  in_place: "whether it is where the task says that it is; yes where the task does not say",
  place: "how likely it is where the task says that it is",
  views: "how many views it is in",
  total: "what the candidates are compared by",
};

export class Why {
  /** `onShow(decision)` receives the decision that is shown. */
  constructor(onShow) {
    this.onShow = onShow;
    this.taskId = null;
    this.decisions = [];
    this.at = -1;
    this.load = coalesced(() => this.fetch());
    $("why-back").addEventListener("click", () => this.show(this.at - 1));
    $("why-on").addEventListener("click", () => this.show(this.at + 1));
  }

  view(task) {
    this.taskId = task?.id ?? null;
    this.decisions = [];
    this.show(-1);
    this.load();
  }

  take(decision) {
    if (decision.task_id !== this.taskId) return;
    const newest = this.at === this.decisions.length - 1;
    const known = this.decisions.findIndex((d) => d.index === decision.index);
    if (known >= 0) this.decisions[known] = decision;
    else this.decisions.push(decision);
    this.show(newest ? this.decisions.length - 1 : this.at);
  }

  async fetch() {
    const id = this.taskId;
    if (id === null) return;
    const { decisions } = await ask(`/tasks/${encodeURIComponent(id)}/decisions`);
    if (id !== this.taskId) return;
    const newest = this.at === this.decisions.length - 1;
    const known = new Set(decisions.map((decision) => decision.index));
    const later = this.decisions.filter((decision) => !known.has(decision.index));
    this.decisions = [...decisions, ...later]; // events may be newer than the response
    const last = this.decisions.length - 1;
    this.show(newest ? last : Math.min(this.at, last));
  }

  show(at) {
    this.at = at;
    const decision = this.decisions[at];
    $("why-empty").hidden = Boolean(decision);
    $("why-table").hidden = !decision?.candidates.length;
    $("why-back").disabled = at <= 0;
    $("why-on").disabled = at >= this.decisions.length - 1;
    $("why-count").textContent = decision ? `${at + 1} of ${this.decisions.length}` : "";
    $("why-rule").textContent = decision ? [words(decision.phase), words(decision.rule)].join(" · ") : "";
    $("why-text").textContent = decision?.why ?? "";
    if (decision) drawTable(decision.candidates);
    this.onShow(decision ?? null);
  }
}

function drawTable(candidates) {
  let names = [...new Set(candidates.flatMap((c) => Object.keys(c.terms)))];
  const isTotal = (name) => candidates.every(({ terms }) => terms[name] === terms.total);
  if (SAME.some(isTotal)) names = names.filter((name) => name !== "total"); // drops the duplicate column
  names.sort((a, b) => LAST.indexOf(a) - LAST.indexOf(b));
  const head = element("tr", {}, element("th", { textContent: "candidate", scope: "col" }));
  head.append(...names.map((name) =>
    element("th", { textContent: termName(name), scope: "col", title: MEANINGS[name] ?? "" })));
  const rows = candidates.map((candidate) => {
    const first = element("td", { textContent: candidate.name || candidate.kind });
    if (candidate.name) first.append(element("small", { textContent: candidate.kind }));
    if (candidate.chosen) first.append(element("span", { className: "hidden", textContent: " (chosen)" }));
    const row = element("tr", { className: candidate.chosen ? "chosen" : "" }, first);
    row.append(...names.map((name) => element("td", { textContent: term(name, candidate.terms[name]) })));
    return row;
  });
  const known = names.filter((name) => MEANINGS[name]);
  $("why-terms").hidden = !known.length;
  $("why-meanings").replaceChildren(...known.flatMap((name) => [
    element("dt", { textContent: termName(name) }), element("dd", { textContent: MEANINGS[name] }),
  ]));
  $("why-table").replaceChildren(element("thead", {}, head), element("tbody", {}, ...rows));
}

/** Number as text, with its significant digits. */
function term(name, value) {
  if (name === "in_place") return value ? "yes" : "no";
  return number(value, name === "views" ? 0 : name.endsWith("_m") ? 2 : 3);
}

/** Term name as text: distance_m → distance (m) */
function termName(name) {
  const unit = /_(m|s|rad|nats|m2)$/.exec(name)?.[1];
  return unit ? `${words(name.slice(0, -unit.length - 1))} (${unit})` : words(name);
}
