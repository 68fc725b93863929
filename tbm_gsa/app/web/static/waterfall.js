// Ten minutes of spectra as colours, the newest at the top.

import { byId, element, moment, number, say, table } from "./dom.js";
import { Plot, drawn, steps } from "./plot.js";
import { allRows, decibel } from "./rows.js";
import { near } from "./spectrum.js";

const LENGTH_MS = 600e3;
const ROW_MS = 4000;
// Even steps of lightness from dark to light, as of the map "viridis".
const STOPS = [[68, 1, 84], [65, 68, 135], [42, 120, 142], [34, 168, 132], [122, 209, 81], [253, 231, 37]];
let side = "field";

function shade(share) {
  const place = Math.max(0, Math.min(1, share)) * (STOPS.length - 1);
  const [first, part] = [Math.min(Math.floor(place), STOPS.length - 2), place % 1];
  const fraction = place === STOPS.length - 1 ? 1 : part;
  return STOPS[first].map((value, channel) => Math.round(value + fraction * (STOPS[first + 1][channel] - value)));
}

function range(rows, bins) {
  const codes = rows.flatMap((row) => Array.from(row[side].slice(2, bins))).filter(Boolean).sort((one, two) => one - two);
  if (!codes.length) return [0, 255];
  return [codes[Math.floor(0.05 * codes.length)], codes[Math.floor(0.995 * (codes.length - 1))]];
}

function show() {
  const high = Number(byId("range").value);
  const rows = allRows().filter((row) => row[side]);
  const end = (allRows().at(-1)?.time ?? Date.now()) + ROW_MS;
  const plot = new Plot(byId("waterfall"), [0, high], [-LENGTH_MS, 0]);
  const minutes = [0, -2, -4, -6, -8, -10].map((value) => [value * 60e3, value ? `${value} min` : "now"]);
  plot.axes(steps(0, high, innerWidth < 600 ? 4 : 8).map((value) => [value, number(value)]), minutes, "Hz", "");
  const bins = Math.round(high / (rows[0]?.step ?? 0.5));
  const [low, top] = range(rows, bins);
  const picture = new OffscreenCanvas(bins, LENGTH_MS / ROW_MS);
  const pen = picture.getContext("2d");
  const image = pen.createImageData(bins, LENGTH_MS / ROW_MS);
  for (const row of rows) {
    const line = Math.round((end - ROW_MS - row.time) / ROW_MS);
    if (line < 0 || line >= image.height) continue;
    for (let bin = 0; bin < bins; bin++) {
      const colours = shade((row[side][bin] - low) / (top - low || 1));
      image.data.set([...colours, 255], 4 * (line * bins + bin));
    }
  }
  pen.putImageData(image, 0, 0);
  plot.inside((over) => {
    over.imageSmoothingEnabled = false;
    const { left, top: above, right, bottom } = plot.box;
    over.drawImage(picture, left, above, right - left, bottom - above);
  });
  const name = side === "field" ? "measured" : "computed";
  if (!rows.length) plot.words(`nothing ${name} in the last ten minutes`);
  const words = `Dark ${decibel(low)} dB to bright ${decibel(top)} dB over 1 m²/s⁴/Hz, ${name}; a row every 4 s, empty where the signal had holes.`;
  say(byId("waterfall-note"), rows.length ? words : "");
  list(rows, bins);
}

// The highest level of each minute, in words.
function list(rows, bins) {
  const details = byId("waterfall-table");
  if (!details.open) return;
  const minutes = Map.groupBy(rows, (row) => Math.floor(row.time / 60e3));
  const lines = [...minutes].reverse().map(([minute, inside]) => {
    let [code, frequency] = [0, 0];
    for (const row of inside) {
      for (let bin = Math.ceil(1 / row.step); bin < bins; bin++) {
        if (row[side][bin] > code) [code, frequency] = [row[side][bin], bin * row.step];
      }
    }
    return [moment(minute * 60e3), number(frequency, 4), near(frequency) || "–", `${decibel(code)} dB`];
  });
  const head = ["Minute", "Strongest line, Hz", "Mark", "Level over 1 m²/s⁴/Hz"];
  details.querySelector(".table").replaceChildren(lines.length ? table(head, lines) : element("p", {}, "no rows"));
}

export function startWaterfall() {
  const draw = drawn(byId("waterfall"), show);
  byId("waterfall-table").addEventListener("toggle", draw);
  byId("side").addEventListener("change", (event) => {
    side = event.target.value;
    draw();
  });
  return draw;
}
