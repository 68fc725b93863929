// Measured beside computed spectrum, with the machine's marks and a cursor that the keyboard moves.

import { byId, element, number, power, say, table } from "./dom.js";
import { Plot, colour, drawn, steps } from "./plot.js";
import { allRows, mean } from "./rows.js";

const DASHES = { mesh: [7, 4], load: [2, 3], axial: [], sideband: [1, 4], shaft: [1, 4] };
const SHOWN = ["mesh", "load", "axial"];
let [marks, mesh, cursor, high, point] = [[], 0, 0, 400, ""];
let shown = {};
let plot = null;
let draw = () => {};

const highest = () => Math.min(high, Number(byId("range").value));
const step = () => allRows().at(-1)?.step ?? 0.5;

function harmonics() {
  const found = [];
  for (let order = 1; order * mesh < high; order++) {
    found.push({ name: order === 1 ? "mesh frequency" : `${order} × mesh frequency`, frequency_hz: order * mesh, kind: "mesh" });
  }
  return found;
}

export function takeLines(setup) {
  [mesh, high] = [setup.mesh_hz, setup.high_hz];
  const other = setup.lines.filter((line) => !/^(2 × )?mesh frequency$/.test(line.name));
  marks = [...harmonics(), ...other].sort((one, two) => one.frequency_hz - two.frequency_hz);
  const kept = byId("mark").value;
  const options = marks.map((one) => element("option", { value: one.frequency_hz }, `${number(one.frequency_hz, 4)} Hz ${one.name}`));
  byId("mark").replaceChildren(element("option", { value: "" }, "a mark …"), ...options);
  byId("mark").value = kept;
  cursor ||= mesh;
  draw();
}

export function spectrumOf(chosen) {
  point = chosen;
  draw();
}

// Greatest level within a step of a frequency, which may lie between two.
function level(density, frequency) {
  if (!density) return null;
  const place = Math.round(frequency / step());
  const near = [place - 1, place, place + 1].map((bin) => density[bin] ?? 0);
  return Math.max(...near) || null;
}

function limits() {
  const values = ["field", "model"].flatMap((side) =>
    shown[side] ? Array.from(shown[side].slice(Math.ceil(1 / step()), Math.round(highest() / step()))) : []).filter((value) => value > 0);
  if (!values.length) return [-8, -2];
  const tops = values.map(Math.log10);
  const [top, bottom] = tops.reduce(([most, least], one) => [Math.max(most, one), Math.min(least, one)], [-99, 99]);
  return [Math.max(Math.floor(bottom), Math.ceil(top) - 8), Math.ceil(top + 0.2)];
}

function show() {
  const count = Number(byId("mean").value);
  shown = { field: mean("field", count), model: mean("model", count) };
  const [low, top] = limits();
  plot = new Plot(byId("spectrum"), [0, highest()], [low, top], { top: 26 });
  const decades = steps(low, top, 6).filter(Number.isInteger).map((value) => [value, power(value)]);
  plot.axes(steps(0, highest(), innerWidth < 600 ? 4 : 8).map((value) => [value, number(value)]), decades, "Hz", "m²/s⁴/Hz");
  plot.inside((pen) => {
    for (const mark of marks.filter((one) => SHOWN.includes(one.kind))) drawMark(pen, mark);
    for (const [side, name] of [["model", "computed"], ["field", "measured"]]) curve(pen, shown[side], colour(name));
    pen.strokeStyle = colour("ink");
    pen.lineWidth = 1.5;
    plot.line([[plot.x(cursor), plot.box.top], [plot.x(cursor), plot.box.bottom]]);
  });
  legend();
  if (!shown.field && !shown.model) plot.words(`no spectrum of ${point} yet: one comes every 4 s`);
  read();
  list();
}

function drawMark(pen, mark) {
  const x = plot.x(mark.frequency_hz);
  pen.strokeStyle = colour(mark.kind === "axial" ? "good" : "quiet");
  pen.lineWidth = 1;
  pen.globalAlpha = 0.7;
  const begin = mark.kind === "axial" ? plot.box.bottom - 14 : plot.box.top;
  plot.line([[x, begin], [x, plot.box.bottom]], DASHES[mark.kind]);
  pen.globalAlpha = 1;
}

function curve(pen, density, line) {
  if (!density) return;
  pen.strokeStyle = line;
  pen.lineWidth = 1.6;
  const points = [];
  for (let bin = Math.ceil(1 / step()); bin < density.length && bin * step() <= highest() + step(); bin++) {
    points.push([plot.x(bin * step()), plot.y(density[bin] > 0 ? Math.log10(density[bin]) : plot.ys[0])]);
  }
  plot.line(points);
}

function legend() {
  const { pen, box } = plot;
  let x = box.left;
  pen.textAlign = "left";
  pen.textBaseline = "middle";
  for (const [side, name] of [["field", "measured"], ["model", "computed"]]) {
    pen.fillStyle = colour(name);
    pen.fillRect(x, 9, 18, 4);
    pen.fillStyle = colour("ink");
    const text = shown[side] ? name : `${name}: none`;
    pen.fillText(text, x + 24, 11);
    x += pen.measureText(text).width + 44;
  }
}

export function near(frequency) {
  const names = marks.filter((one) => Math.abs(one.frequency_hz - frequency) <= step() * 0.75).map((one) => one.name);
  return names.length ? names.join(", ") : "";
}

function read() {
  const values = ["field", "model"].map((side) => number(level(shown[side], cursor)));
  const name = near(cursor);
  const text = `${number(cursor, 4)} Hz${name ? `, ${name}` : ""}: measured ${values[0]}, computed ${values[1]} m²/s⁴/Hz`;
  say(byId("cursor"), text);
  const canvas = byId("spectrum");
  const attributes = { "aria-valuemin": 0, "aria-valuemax": highest(), "aria-valuenow": cursor, "aria-valuetext": text };
  for (const [key, value] of Object.entries(attributes)) canvas.setAttribute(key, value);
}

function list() {
  const details = byId("spectrum-table");
  if (!details.open) return;
  const rows = marks.map((one) => [
    one.name, number(one.frequency_hz, 4), number(level(shown.field, one.frequency_hz)), number(level(shown.model, one.frequency_hz)),
  ]);
  const head = ["Mark", "Hz", "Measured, m²/s⁴/Hz", "Computed, m²/s⁴/Hz"];
  details.querySelector(".table").replaceChildren(table(head, rows));
}

function move(frequency) {
  cursor = Math.max(0, Math.min(frequency, highest()));
  draw();
}

function onKey(event) {
  const others = marks.map((one) => one.frequency_hz).filter((value) => value <= highest());
  const moves = {
    ArrowRight: () => cursor + step(),
    ArrowLeft: () => cursor - step(),
    ArrowUp: () => cursor + step(),
    ArrowDown: () => cursor - step(),
    PageUp: () => others.find((value) => value > cursor + 1e-6) ?? cursor,
    PageDown: () => others.findLast((value) => value < cursor - 1e-6) ?? cursor,
    Home: () => mesh,
    End: () => highest(),
  };
  if (!(event.key in moves)) return;
  event.preventDefault();
  move(moves[event.key]());
}

export function startSpectrum(redrawOthers) {
  draw = drawn(byId("spectrum"), show);
  const canvas = byId("spectrum");
  canvas.addEventListener("keydown", onKey);
  canvas.addEventListener("pointerdown", (event) => move(plot.at(event.offsetX)));
  canvas.addEventListener("pointermove", (event) => event.buttons && move(plot.at(event.offsetX)));
  byId("mark").addEventListener("change", (event) => event.target.value && move(Number(event.target.value)));
  byId("spectrum-table").addEventListener("toggle", draw);
  for (const name of ["mean", "range"]) byId(name).addEventListener("change", () => [draw(), redrawOthers()]);
  return draw;
}
