// Times and texts of stop-now and clear-stop.
import { Problem } from "./api.js";

export const COMMANDS = {
  "stop": {
    doing: "Stopping…",
    within_ms: 3000, // the gateway waits one second for the bridge
    failed: "The stop did not get through",
    late: "It is not known whether the robot stops",
    instead: "Press again, or use the switch on the robot.",
  },
  "clear-stop": {
    doing: "Clearing…",
    within_ms: 8000,
    failed: "Not cleared",
    late: "It is not known whether the stop is lifted",
    instead: "",
  },
};

/** Sentence about a command that failed with an error. */
export function whyNot(what, error) {
  const { within_ms, failed, late, instead } = COMMANDS[what];
  const isLate = error.name === "TimeoutError";
  const why = error instanceof Problem ? error.message.replace(/\.$/, "")
    : isLate ? `no answer came within ${within_ms / 1000} s`
    : "the gateway cannot be reached";
  return `${isLate ? late : failed}: ${why}. ${instead}`.trim();
}
