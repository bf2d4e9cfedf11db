// Tasks to try: of things that the detector knows, and that this robot can do.
import { words } from "./api.js";

const MOST = 3;
const TASKS = [
  { text: "Move the mug from the coffee table to the kitchen counter", moves: true,
    names: ["mug", "coffee table", "kitchen counter"] },
  { text: "Find the apple", names: ["apple"] },
  { text: "Go to the sofa", names: ["sofa"] },
];

/** `vocabulary` as /v1/vocabulary tells it; `hasArm`: whether the robot can pick and place. */
export function suggestions({ open, names }, hasArm) {
  const known = names.map(words);
  const able = TASKS.filter((task) => hasArm || !task.moves);
  if (open) return able.map((task) => task.text);
  const right = able.filter((task) => task.names.every((name) => known.includes(name)));
  const named = new Set(right.flatMap((task) => task.names));
  const others = known.filter((name) => !named.has(name)).map((name) => `Find the ${name}`);
  return [...right.map((task) => task.text), ...others].slice(0, MOST);
}

/** What may have been seen: a name, since not every scorer can be asked in other words. */
export function exampleOf({ open, names }) {
  return open || names.includes("mug") ? "mug" : words(names[0] ?? "");
}
