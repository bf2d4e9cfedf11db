// Example text in the query box for past views.
import { words } from "./api.js";

/** Example query: a name, because some scorers accept only names. */
export function exampleOf({ open, names }) {
  return open || names.includes("mug") ? "mug" : words(names[0] ?? "");
}
