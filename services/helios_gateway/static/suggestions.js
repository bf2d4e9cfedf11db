// What the box for past views shows as an example.
import { words } from "./api.js";

/** What may have been seen: a name, since not every scorer can be asked in other words. */
export function exampleOf({ open, names }) {
  return open || names.includes("mug") ? "mug" : words(names[0] ?? "");
}
