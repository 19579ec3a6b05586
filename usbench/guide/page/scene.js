// The phantom from above and from the side, and the axes of the frame, all in mm. Same picture as usbench/envs/scene.py.

const NS = "http://www.w3.org/2000/svg";
const range = (low, high, step) => Array.from({ length: Math.floor((high - low) / step) + 1 }, (_, i) => low + i * step);
const signed = (number) => (number > 0 ? "+" : number < 0 ? "\u2212" : "") + Math.abs(number);
const radians = (degrees) => (degrees * Math.PI) / 180;

function shape(name, attributes, text) {
  const made = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}
const rectangle = (x, y, width, height, kind) => shape("rect", { x, y, width, height, class: kind });
const line = (x1, y1, x2, y2, kind) => shape("line", { x1, y1, x2, y2, class: kind });
const polygon = (points, kind) => shape("polygon", { points: points.join(" "), class: kind });
const dot = (cx, cy, r, kind) => shape("circle", { cx, cy, r, class: kind });
const label = (x, y, text, anchor) => shape("text", { x, y, "text-anchor": anchor }, text);

function cross(x, y) {
  return ["rim", "cross"].flatMap((kind) => [line(x - 2, y, x + 2, y, kind), line(x, y - 2, x, y + 2, kind)]);
}

// The object's balls, those nearest to the eye last; `across` is the axis that is drawn downwards.
function balls(all, across, towards) {
  const shades = ["body", "limb"].map((name) => {
    const gradient = shape("radialGradient", { id: `${name}-${across}`, cx: 0.36, cy: 0.3, r: 0.75 });
    gradient.append(shape("stop", { offset: 0, class: `${name} light` }), shape("stop", { offset: 1, class: `${name} dark` }));
    return gradient;
  });
  const drawn = all.map((ball, index) => ({ ball, index })).sort((a, b) => towards(a.ball) - towards(b.ball)).map(
    ({ ball, index }) => shape("circle", { cx: ball[0], cy: ball[across], r: ball[3], fill: `url(#${index ? "limb" : "body"}-${across})` }));
  return [...shades, ...drawn];
}

// In an anatomy of one's own, in place of balls: the image plane of the target.
function planeAbove(target, probe) {
  if (!target) return [];
  const plane = shape("g", { transform: `translate(${target.x_mm} 0) rotate(${target.angle_deg})` });
  plane.append(line(-probe.width / 2, 0, probe.width / 2, 0, "target"));
  return [plane];
}

function planeAside(target, probe, depth) {
  if (!target) return [];
  const half = Math.max((Math.abs(Math.cos(radians(target.angle_deg))) * probe.width) / 2, 0.4);
  return [rectangle(target.x_mm - half, 0, 2 * half, depth, "target")];
}

function ground(phantom, top, bottom, step) {
  const half = phantom.width_mm / 2, xs = range(-half, half, 20), ys = range(top, bottom, step);
  return [
    rectangle(-half, top, phantom.width_mm, bottom - top, "tissue"),
    ...xs.map((x) => line(x, top, x, bottom, "grid")),
    ...ys.map((y) => line(-half, y, half, y, "grid")),
    ...xs.map((x) => label(x, bottom + 4.5, signed(x), "middle")),
    ...ys.map((y) => label(-half - 1.5, y + 1.2, top ? signed(y) : y, "end")),
  ];
}

function drawAbove(svg, { phantom, probe, pose, target, balls: all }) {
  const { width_mm: width, height_mm: height } = phantom, half = probe.width / 2, slab = probe.slab / 2;
  svg.setAttribute("viewBox", `${-width / 2 - 10} ${-height / 2 - 2} ${width + 14} ${height + 8}`);
  const hand = shape("g", { transform: `translate(${pose.x_mm} 0) rotate(${pose.angle_deg})` });
  hand.append(rectangle(-half, -slab, 2 * half, 2 * slab, "slab"), line(-half, 0, half, 0, "plane"),
    dot(2.5 - half, 2.2 - slab, 0.9, "metal"));
  svg.replaceChildren(...ground(phantom, -height / 2, height / 2, 20), ...balls(all, 1, (ball) => -ball[2]),
    ...planeAbove(target, probe), hand, ...cross(pose.x_mm, 0));
  svg.setAttribute("aria-label", `Phantom from above: the probe at x ${pose.x_mm} mm, its image plane turned by ${pose.angle_deg} degrees`);
}

function drawSide(svg, { phantom, probe, pose, target, balls: all }) {
  const { width_mm: width, depth_mm: depth } = phantom, x = pose.x_mm, focus = pose.focal_depth_mm;
  svg.setAttribute("viewBox", `${-width / 2 - 10} -9 ${width + 14} ${depth + 16}`);
  const cosine = Math.cos(radians(pose.angle_deg)), sine = Math.sin(radians(pose.angle_deg));
  const slab = (Math.abs(cosine) * probe.width + Math.abs(sine) * probe.slab) / 2;
  const aperture = (Math.abs(cosine) * probe.aperture) / 2, reach = Math.min(1, (depth - focus) / focus);
  const foot = focus * (1 + reach), spread = aperture * reach, shell = slab + 1, handle = 0.72 * shell;
  svg.replaceChildren(
    ...ground(phantom, 0, depth, 10),
    ...balls(all, 2, (ball) => ball[1]),
    ...planeAside(target, probe, depth),
    rectangle(x - slab, 0, 2 * slab, depth, "slab"),
    polygon([x - aperture, 0, x + aperture, 0, x, focus], "beam"),
    polygon([x, focus, x + spread, foot, x - spread, foot], "beam"),
    line(x - slab, focus, x + slab, focus, "line"),
    polygon([x - handle, -7.6, x + handle, -7.6, x + shell, -2.4, x + shell, 0, x - shell, 0, x - shell, -2.4], "metal"),
    line(x - slab, 0, x + slab, 0, "plane"),
    dot(x - cosine * (probe.width / 2 - 2.5), -2, 0.9, "mark"),
    ...cross(x, focus));
  svg.setAttribute("aria-label", `Phantom from the side: the probe at x ${x} mm, focused at a depth of ${focus} mm`);
}

// The frame's left upper corner is at (0, 0).
function drawAxes(svg, { shape: [height, width], pose }) {
  const focus = pose.focal_depth_mm;
  svg.replaceChildren(
    ...range(0, height, 10).map((mm) => label(-1.2, mm + 1, mm, "end")),
    ...[0, width / 2, width].map((x) => label(x, height + 4.5, signed(x - width / 2), "middle")),
    dot(2.5, -2, 0.9, "metal"),
    polygon([width + 0.6, focus, width + 3.4, focus - 1.6, width + 3.4, focus + 1.6], "pointer"));
}

export function drawScene(above, side, axes, state) {
  drawAbove(above, state);
  drawSide(side, state);
  drawAxes(axes, state);
}
