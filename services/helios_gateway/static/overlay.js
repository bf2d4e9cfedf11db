// Overlay on the map's cells: trajectory, path, frontiers, objects, robot.
import { $, number } from "./api.js";

const FONT = "600 12px system-ui, sans-serif";
const FEWEST_PX = 32; // per metre; at a smaller scale, values of frontiers would cover the map

export function drawOverlay(context, view, colors) {
  const labels = new Labels(context, colors);
  const ruler = drawRuler(context, view, colors);
  labels.taken.push([0, 0, ruler, 26]);
  context.lineJoin = context.lineCap = "round";
  if ($("show-trajectory").checked) {
    const walked = view.info.trajectory_m;
    const ends = [...view.info.trajectory_starts, walked.length];
    ends.forEach((end, k) =>
      haloed(context, view, walked.slice(ends[k - 1] ?? 0, end), colors, colors.way, 2, []),
    );
  }
  if ($("show-path").checked && view.plan?.path_m.length) {
    haloed(context, view, view.plan.path_m, colors, colors.plan, 3.5, [7, 7]);
    goal(context, view, view.plan.path_m.at(-1), colors);
  }
  const robot = view.robot?.pose ?? view.info.robot;
  if (robot) {
    drawRobot(context, view, robot, colors);
    labels.block(...view.toScreen([robot.x_m, robot.y_m]), 16);
  }
  if ($("show-objects").checked) drawObjects(context, view, colors, labels);
  if ($("show-frontiers").checked) drawFrontiers(context, view, colors, labels);
  if (view.decision) drawChosen(context, view, colors);
  if (view.pointed) ring(context, view.toScreen(view.pointed), 22, colors.object);
  labels.draw();
  const many = (list, word) => `${list.length} ${word}${list.length === 1 ? "" : "s"}`;
  view.canvas.ariaLabel =
    `2D map of the home: ${many(view.objects, "object")}, ${many(view.frontiers, "frontier")}` +
    (robot ? `, robot at x ${number(robot.x_m, 1)} m, y ${number(robot.y_m, 1)} m` : "");
}

/** Line with a halo, so that it is visible on a value layer, too. */
function haloed(context, view, points, colors, color, width, dash) {
  line(context, view, points, colors.label, width + 2, []);
  line(context, view, points, color, width, dash);
}

function line(context, view, points, color, width, dash) {
  if (points.length < 2) return;
  context.save();
  context.beginPath();
  points.forEach((point) => context.lineTo(...view.toScreen(point)));
  context.strokeStyle = color;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.restore();
}

function goal(context, view, point, colors) {
  const [x, y] = view.toScreen(point);
  context.beginPath();
  context.arc(x, y, 5, 0, 2 * Math.PI);
  context.fillStyle = colors.plan;
  context.strokeStyle = colors.card;
  context.lineWidth = 2;
  context.fill();
  context.stroke();
}

function drawRobot(context, view, pose, colors) {
  const [x, y] = view.toScreen([pose.x_m, pose.y_m]);
  const radius = Math.max(9, (view.description?.footprint_radius_m ?? 0.2) * view.scale);
  context.save();
  context.translate(x, y);
  context.rotate(-pose.yaw_rad);
  const glow = context.createRadialGradient(0, 0, radius, 0, 0, radius * 4.5);
  glow.addColorStop(0, `${colors.robot}66`);
  glow.addColorStop(1, `${colors.robot}00`);
  context.beginPath(); // viewing direction
  context.moveTo(0, 0);
  context.arc(0, 0, radius * 4.5, -0.55, 0.55);
  context.fillStyle = glow;
  context.fill();
  context.beginPath();
  context.arc(0, 0, radius, 0, 2 * Math.PI);
  context.fillStyle = colors.robot;
  context.strokeStyle = colors.card;
  context.lineWidth = 2.5;
  context.fill();
  context.stroke();
  context.beginPath(); // heading
  context.moveTo(radius * 0.65, 0);
  context.lineTo(-radius * 0.35, radius * 0.5);
  context.lineTo(-radius * 0.1, 0);
  context.lineTo(-radius * 0.35, -radius * 0.5);
  context.closePath();
  context.fillStyle = colors.card;
  context.fill();
  context.restore();
}

function drawObjects(context, view, colors, labels) {
  for (const object of view.objects) {
    const [cx, cy] = object.center_m;
    const [width, depth] = object.size_m;
    if ([cx, cy, width, depth].includes(null)) continue;
    const box = [[-1, -1], [1, -1], [1, 1], [-1, 1]];
    const around = box.map(([i, j]) => [cx + (i * width) / 2, cy + (j * depth) / 2]);
    const outline = object.outline_m.length > 2 ? object.outline_m : around;
    const points = outline.map((point) => view.toScreen(point));
    context.beginPath();
    points.forEach((point) => context.lineTo(...point));
    context.closePath();
    context.strokeStyle = colors.object;
    context.lineWidth = 2;
    context.fillStyle = `${colors.object}2e`;
    context.fill();
    context.stroke();
    const xs = points.map((point) => point[0]);
    const [left, right] = [Math.min(...xs), Math.max(...xs)];
    const at = view.toScreen([cx, cy]);
    if (right - left < 10) {
      labels.block(...at, 5);
      context.beginPath();
      context.arc(...at, 5, 0, 2 * Math.PI);
      context.fillStyle = colors.object;
      context.strokeStyle = colors.card;
      context.fill();
      context.stroke();
    }
    const text = `${object.class} Ψ ${number(object.score)}`;
    labels.add(text, at, Math.max(8, (right - left) / 2), colors.object, object.score ?? 0);
  }
}

function drawFrontiers(context, view, colors, labels) {
  const layer = view.layer === "occupancy" ? null : view.layer;
  for (const frontier of view.frontiers) {
    if (frontier.center_m.includes(null)) continue;
    const at = view.toScreen(frontier.center_m);
    labels.block(...at, 6);
    context.beginPath();
    context.arc(...at, frontier.reachable ? 6 : 5, 0, 2 * Math.PI);
    context.fillStyle = frontier.reachable ? colors.frontier : colors.beyond;
    context.strokeStyle = colors.card;
    context.lineWidth = 2;
    context.fill();
    context.stroke();
    const values = Object.entries(frontier.values).filter(([name]) => !layer || name === layer);
    const text = values.map(([name, value]) => `${layer ? "" : `${name} `}${number(value)}`).join(" · ");
    if (text && view.scale >= FEWEST_PX) labels.add(text, at, 8, colors.text, -1);
  }
}

function drawChosen(context, view, colors) {
  for (const { chosen, position_m: [x, y] } of view.decision.candidates) {
    if (!chosen || x === null || y === null) continue;
    ring(context, view.toScreen([x, y]), 15, colors.plan);
  }
}

function ring(context, at, radius, color) {
  context.beginPath();
  context.arc(...at, radius, 0, 2 * Math.PI);
  context.strokeStyle = color;
  context.lineWidth = 3;
  context.stroke();
}

function drawRuler(context, view, colors) {
  const metres = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20].find((m) => m * view.scale > 60) ?? 50;
  const [x, y] = [14, 20];
  context.beginPath();
  context.moveTo(x, y - 5);
  context.lineTo(x, y);
  context.lineTo(x + metres * view.scale, y);
  context.lineTo(x + metres * view.scale, y - 5);
  context.strokeStyle = colors.muted;
  context.lineWidth = 1.5;
  context.stroke();
  context.font = FONT;
  context.fillStyle = colors.muted;
  context.fillText(`${metres} m`, x + 6, y - 5);
  return x + metres * view.scale + 8; // right end of the ruler
}

/** Labels beside their points, without overlap; a higher weight is placed first. */
class Labels {
  constructor(context, colors) {
    this.context = context;
    this.colors = colors;
    this.wanted = [];
    this.taken = [];
  }

  block(x, y, radius) {
    this.taken.push([x - radius, y - radius, x + radius, y + radius]);
  }

  add(text, at, radius, color, weight) {
    this.wanted.push({ text, at, radius, color, weight });
  }

  draw() {
    const { context } = this;
    context.font = FONT;
    context.textBaseline = "middle";
    this.wanted.sort((a, b) => b.weight - a.weight);
    for (const { text, at: [x, y], radius, color } of this.wanted) {
      const [width, height] = [context.measureText(text).width + 10, 19];
      const places = [
        [x + radius + 3, y - height / 2], [x - radius - 3 - width, y - height / 2],
        [x - width / 2, y - radius - 4 - height], [x - width / 2, y + radius + 4],
      ];
      const { clientWidth, clientHeight } = context.canvas;
      const inside = ([left, top]) =>
        left >= 0 && top >= 0 && left + width <= clientWidth && top + height <= clientHeight;
      const off = x < 0 || y < 0 || x > clientWidth || y > clientHeight;
      const free = !off && places.filter(inside).find((place) => !this.taken.some((box) => overlap(box, place, width, height)));
      if (!free) continue;
      this.taken.push([free[0], free[1], free[0] + width, free[1] + height]);
      context.beginPath();
      context.roundRect(...free, width, height, 6);
      context.fillStyle = this.colors.label;
      context.fill();
      context.fillStyle = color;
      context.fillText(text, free[0] + 5, free[1] + height / 2 + 0.5);
    }
    context.textBaseline = "alphabetic";
  }
}

function overlap([left, top, right, bottom], [x, y], width, height) {
  return x < right && x + width > left && y < bottom && y + height > top;
}
