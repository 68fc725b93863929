// Spectra of the chosen point: the rows of the last minutes, decoded.

const LOWEST_DB = -120; // as the server codes them, over 1 m²/s⁴/Hz
const STEP_DB = 0.75;
const MOST = 150;

export const decibel = (code) => LOWEST_DB + STEP_DB * code;
const DENSITY = Float64Array.from({ length: 256 }, (_, code) => (code ? 10 ** (decibel(code) / 10) : 0));

let point = "";
let rows = [];
let heard = () => {};

function decoded(row) {
  const sides = row.points[point] ?? {};
  const bytes = (text) => (text ? Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)) : null);
  return { time: new Date(row.time).getTime(), step: row.step_hz, model: bytes(sides.model), field: bytes(sides.field) };
}

export function onRows(call) {
  heard = call;
}

export const allRows = () => rows;

export function takeRow(row) {
  const found = decoded(row);
  rows = [...rows.filter((one) => one.time < found.time), found].slice(-MOST);
  heard();
}

export async function rowsOf(chosen) {
  point = chosen;
  rows = [];
  heard();
  try {
    const answer = await fetch(`/waterfall/${encodeURIComponent(chosen)}`);
    const before = answer.ok ? await answer.json() : { rows: [] };
    if (point !== chosen) return;
    const since = rows[0]?.time ?? Infinity; // what came meanwhile stays
    rows = [...before.rows.map(decoded).filter((one) => one.time < since), ...rows].slice(-MOST);
    heard();
  } catch {
    // the connection is lost: the next row comes with it
  }
}

// Mean density of the newest so many rows of a side; null where there is none.
export function mean(side, count) {
  const used = rows.slice(-count).map((row) => row[side]).filter(Boolean);
  if (!used.length) return null;
  const length = Math.min(...used.map((one) => one.length));
  const sum = new Float64Array(length);
  for (const one of used) for (let bin = 0; bin < length; bin++) sum[bin] += DENSITY[one[bin]];
  return sum.map((value) => value / used.length);
}
