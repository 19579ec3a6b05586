// The phantom from above and from the side, in mm, and the axes of the frame. Same picture as envs/scene/picture.py.

const NS = "http://www.w3.org/2000/svg";
function multiples(low, high, step) {
  const first = Math.ceil(low / step), last = Math.floor(high / step);
  return Array.from({ length: last - first + 1 }, (_, i) => (first + i) * step);
}
export const signed = (number) => (number > 0 ? "+" : number < 0 ? "\u2212" : "") + Math.abs(number);
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

// In a custom anatomy, in place of balls: the image plane of the target.
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

// A probe may be wider than the phantom: half of what its picture shows, from x = 0.
const halfWidth = ({ phantom, probe, reach_mm: reach }) => Math.max(phantom.width_mm / 2, reach + probe.width / 2);

function ground(phantom, top, bottom, step, left) {
  const half = phantom.width_mm / 2, xs = multiples(-half, half, 20), ys = multiples(top, bottom, step);
  return [
    rectangle(-half, top, phantom.width_mm, bottom - top, "tissue"),
    ...xs.map((x) => line(x, top, x, bottom, "grid")),
    ...ys.map((y) => line(-half, y, half, y, "grid")),
    ...xs.map((x) => label(x, bottom + 4.5, signed(x), "middle")),
    ...ys.map((y) => label(left - 1.5, y + 1.2, top ? signed(y) : y, "end")),
  ];
}

function drawAbove(svg, state) {
  const { phantom, probe, pose, target, balls: all } = state, height = phantom.height_mm;
  const side = halfWidth(state), half = probe.width / 2, slab = probe.slab / 2;
  svg.setAttribute("viewBox", `${-side - 10} ${-height / 2 - 2} ${2 * side + 14} ${height + 8}`);
  const hand = shape("g", { transform: `translate(${pose.x_mm} 0) rotate(${pose.angle_deg})` });
  hand.append(rectangle(-half, -slab, 2 * half, 2 * slab, "slab"), line(-half, 0, half, 0, "plane"),
    dot(2.5 - half, 2.2 - slab, 0.9, "metal"));
  svg.replaceChildren(...ground(phantom, -height / 2, height / 2, 20, -side), ...balls(all, 1, (ball) => -ball[2]),
    ...planeAbove(target, probe), hand, ...cross(pose.x_mm, 0));
  svg.setAttribute("aria-label", `Phantom from above: the probe at x ${pose.x_mm} mm, its image plane turned by ${pose.angle_deg} degrees`);
}

function drawSide(svg, state) {
  const { phantom, probe, pose, target, balls: all } = state, side = halfWidth(state);
  const depth = phantom.depth_mm, x = pose.x_mm, focus = pose.focal_depth_mm;
  svg.setAttribute("viewBox", `${-side - 10} -9 ${2 * side + 14} ${depth + 16}`);
  const cosine = Math.cos(radians(pose.angle_deg)), sine = Math.sin(radians(pose.angle_deg));
  const slab = (Math.abs(cosine) * probe.width + Math.abs(sine) * probe.slab) / 2;
  const aperture = (Math.abs(cosine) * probe.aperture) / 2, reach = Math.min(1, (depth - focus) / focus);
  const foot = focus * (1 + reach), spread = aperture * reach, shell = slab + 1, handle = 0.72 * shell;
  svg.replaceChildren(
    ...ground(phantom, 0, depth, 10, -side),
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

// Lengths of the frame's picture: as high as 90 or as wide as 60, so that letters have one size beside any frame.
const MARGIN = { left: 9, top: 5, right: 5, bottom: 6 };
function frameLayout([depth, width]) {
  const scale = Math.min(90 / depth, 60 / width), wide = width * scale, high = depth * scale;
  return { scale, wide, high, allWide: MARGIN.left + wide + MARGIN.right, allHigh: MARGIN.top + high + MARGIN.bottom };
}

// The frame lies inside its axes, whose size in the page follows from the style sheet.
function placeFrame(view, canvas, { wide, high, allWide, allHigh }) {
  const lengths = { "--wide": allWide, "--high": allHigh, "--left": MARGIN.left / allWide, "--top": MARGIN.top / allHigh,
    "--frame-wide": wide / allWide, "--frame-high": high / allHigh };
  for (const [name, value] of Object.entries(lengths)) view.style.setProperty(name, value);
  const size = [Math.round(6 * wide), Math.round(6 * high)];
  if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
}

// The frame's left upper corner is at (0, 0).
function drawAxes(svg, { frame_mm: [depth, width], pose }, { scale, wide, high, allWide, allHigh }) {
  const focus = pose.focal_depth_mm * scale, half = Math.trunc(width / 2);
  const step = [1, 2, 5, 10, 20, 50, 100].find((mm) => mm * scale >= 8) ?? 200;
  svg.setAttribute("viewBox", `${-MARGIN.left} ${-MARGIN.top} ${allWide} ${allHigh}`);
  svg.replaceChildren(
    ...multiples(0, depth, step).map((mm) => label(-1.2, mm * scale + 1, mm, "end")),
    ...[...new Set([-half, 0, half])].map((mm) => label(wide / 2 + mm * scale, high + 4.5, signed(mm), "middle")),
    dot(2.5, -2, 0.9, "metal"),
    ...(focus <= high ? [polygon([wide + 0.6, focus, wide + 3.4, focus - 1.6, wide + 3.4, focus + 1.6], "pointer")] : []));
}

export function drawScene({ above, side, view, canvas, axes }, state) {
  const layout = frameLayout(state.frame_mm);
  drawAbove(above, state);
  drawSide(side, state);
  placeFrame(view, canvas, layout);
  drawAxes(axes, state, layout);
}
