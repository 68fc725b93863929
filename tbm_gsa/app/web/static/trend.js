// Measured over computed level through an hour, a day or a week, with its limits.

import { byId, element, moment, number, say, table } from "./dom.js";
import { Plot, colour, drawn, steps } from "./plot.js";

const trends = {};
let [span, point] = ["hour", ""];
let [limitsOf, limitsAre] = [{}, ""];
let draw = () => {};

function show() {
  const canvas = byId("trend");
  const trend = trends[span];
  const bins = trend?.points[point] ?? [];
  const limits = limitsOf[point];
  const size = (trend?.bin_s ?? 60) * 1000;
  const end = (Math.floor((trend ? new Date(trend.end) : Date.now()) / size) + 1) * size; // of the bin that is not over
  const length = size * (trend?.bins ?? 60);
  const values = bins.flatMap((bin) => [bin.low, bin.high]).concat(limits ? [limits.low, limits.high] : []);
  const [low, high] = values.length ? [Math.min(...values), Math.max(...values)] : [0.5, 1.5];
  const room = 0.1 * (high - low || 1);
  const plot = new Plot(canvas, [end - length, end], [Math.max(0, low - room), high + room]);
  const yTicks = steps(plot.ys[0], plot.ys[1], 5).map((value) => [value, number(value)]);
  plot.axes(times(end, length), yTicks, "", "measured / computed");
  plot.inside((pen) => {
    if (limits) {
      pen.fillStyle = colour("band");
      pen.globalAlpha = 0.6;
      const [top, bottom] = [plot.y(limits.high), plot.y(limits.low)];
      pen.fillRect(plot.box.left, top, plot.box.right - plot.box.left, bottom - top);
      pen.globalAlpha = 1;
    }
    pen.strokeStyle = pen.fillStyle = colour("measured");
    const at = (bin) => plot.x(new Date(bin.begin).getTime() + size / 2);
    pen.lineWidth = Math.max(2, Math.min(10, (0.5 * (plot.box.right - plot.box.left)) / (trend?.bins ?? 60)));
    pen.globalAlpha = 0.35;
    for (const bin of bins) plot.line([[at(bin), plot.y(bin.low)], [at(bin), plot.y(bin.high)]]);
    pen.globalAlpha = 1;
    for (const bin of bins) {
      pen.beginPath();
      pen.arc(at(bin), plot.y(bin.median), 2.5, 0, 7);
      pen.fill();
    }
  });
  if (!bins.length) plot.words(trend ? trend.problem || `no window of ${point} in the last ${span}` : "reading the history …");
  const latest = bins.at(-1);
  canvas.setAttribute("aria-label", `Trend of ${point}, last ${span}: ${latest ? `now ${number(latest.median)}` : "no window"}`);
  say(byId("trend-note"), note(trend, limits));
  list(bins);
}

function note(trend, limits) {
  const parts = ["Dot: median, bar: 5 to 95 % of the windows."];
  if (limits) parts.push(`Shaded: ${number(limits.low)} to ${number(limits.high)}, ${limitsAre}.`);
  if (trend?.problem) parts.push(trend.problem);
  return parts.join(" ");
}

function times(end, length) {
  const count = innerWidth < 600 ? 3 : 6;
  return Array.from({ length: count + 1 }, (_, place) => {
    const time = new Date(end - length + (place * length) / count);
    const day = length > 2 * 86400e3;
    const form = day ? { weekday: "short", hour: "2-digit", minute: "2-digit" } : { hour: "2-digit", minute: "2-digit" };
    return [time.getTime(), place === 0 || place === count ? "" : time.toLocaleString("en-GB", form)];
  });
}

function list(bins) {
  const details = byId("trend-table");
  if (!details.open) return;
  const head = ["Begin", "Windows", "5 %", "Median", "95 %", "Measured, m/s²"];
  const rows = bins.toReversed().map((one) => [
    moment(one.begin), String(one.windows), number(one.low), number(one.median), number(one.high), number(one.level),
  ]);
  details.querySelector(".table").replaceChildren(rows.length ? table(head, rows) : element("p", {}, "no windows"));
}

export function startTrend() {
  draw = drawn(byId("trend"), show);
  byId("trend-table").addEventListener("toggle", draw);
  byId("span").addEventListener("change", (event) => {
    span = event.target.value;
    draw();
  });
}

export function takeTrend(trend) {
  trends[trend.span] = trend;
  if (trend.span === span) draw();
}

export function takeLimits(now) {
  const changed = JSON.stringify(now.limits) !== JSON.stringify(limitsOf);
  [limitsOf, limitsAre] = [now.limits, now.limits_are];
  if (changed) draw();
}

export function trendOf(chosen) {
  point = chosen;
  draw();
}
