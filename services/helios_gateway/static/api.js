// The HTTP interface, and small helpers for the page.

export class Problem extends Error {}

export const robot = new URLSearchParams(location.search).get("robot");
const base = robot === null ? "/v1" : `/v1/robots/${encodeURIComponent(robot)}`;

let onRefused = () => {};
/** `handle` is called when a key is asked for, or another one is needed. */
export const whenRefused = (handle) => (onRefused = handle);

/** The full address of a path below that of the robot on show. */
export const address = (path) => base + path;

/** A response of the interface. `path` is below that of the robot on show. */
export async function get(path, options = {}) {
  const response = await fetch(base + path, options);
  if (response.status === 401) onRefused();
  return response;
}

/** JSON of an address. Throws Problem with the server's sentence, TypeError when it is away. */
export async function ask(path, options = {}) {
  const response = await get(path, options);
  const body = await response.json().catch(() => ({}));
  if (!response.ok) throw new Problem(body.detail ?? `${path} answered ${response.status}`);
  return body;
}

export const send = (path, body, options = {}) =>
  ask(path, {
    ...options,
    method: "POST",
    headers: { "content-type": "application/json" },
    body: body === undefined ? undefined : JSON.stringify(body),
  });

/** Events by type until the page closes; comes back by itself. */
export function listen(handlers, onOpen, onLost) {
  let source;
  const open = () => {
    source = new EventSource(`${base}/events`);
    source.onopen = onOpen;
    source.onerror = () => {
      onLost();
      ask("/status").catch(() => {}); // says whether a key is asked for
      if (source.readyState === EventSource.CLOSED) setTimeout(open, 2000);
    };
    for (const [type, handle] of Object.entries(handlers)) {
      source.addEventListener(type, (event) => handle(JSON.parse(event.data)));
    }
  };
  open();
}

/** Runs `work` soon, once however often it is asked for meanwhile, never twice at a time. */
export function coalesced(work) {
  let running = false;
  let again = false;
  return async function run() {
    if (running) {
      again = true;
      return;
    }
    running = true;
    try {
      await work();
    } catch (error) {
      if (!(error instanceof Problem || error instanceof TypeError)) throw error;
    } finally {
      running = false;
      if (again) {
        again = false;
        run();
      }
    }
  };
}

export const $ = (id) => document.getElementById(id);

export function element(tag, properties = {}, ...children) {
  const out = Object.assign(document.createElement(tag), properties);
  out.append(...children);
  return out;
}

export const number = (value, digits = 2) => (value == null ? "–" : value.toFixed(digits));
export const words = (name) => name.replaceAll("_", " ");

export function facts(list, pairs) {
  list.replaceChildren(
    ...pairs
      .filter(([, value]) => value !== "" && value != null)
      .map(([name, value]) =>
        element("div", {}, element("dt", { textContent: name }), element("dd", { textContent: value })),
      ),
  );
}
