// The page: each section of what comes goes to the part that shows it.

import { byId, element, say } from "./dom.js";
import { showDrives } from "./drives.js";
import { allow, startEvents, takeEvents } from "./events.js";
import { connect } from "./link.js";
import { drawMachine, showLevels } from "./machine.js";
import { startPages } from "./pages.js";
import { onRows, rowsOf, takeRow } from "./rows.js";
import { spectrumOf, startSpectrum, takeLines } from "./spectrum.js";
import { startTrend, takeLimits, takeTrend, trendOf } from "./trend.js";
import { showLost, showNodes, showOperation, showVerdict } from "./verdict.js";
import { startWaterfall } from "./waterfall.js";

function choose(point) {
  trendOf(point);
  spectrumOf(point);
  rowsOf(point);
}

function offer(points) {
  const field = byId("point");
  const before = field.querySelector(":checked")?.value;
  const chosen = points.includes(before) ? before : points[0];
  const choices = points.map((point, place) =>
    element("label", {}, element("input", { type: "radio", name: "point", value: point, checked: point === chosen }), ` ${place + 1} ${point}`),
  );
  field.replaceChildren(field.querySelector("legend"), ...choices);
  choose(chosen);
}

let token = "";

function setUp(setup) {
  say(byId("name"), setup.machine);
  byId("name").title = setup.title;
  drawMachine(setup);
  takeLines(setup);
  allow(setup);
  if (token === setup.token) return; // only its lines have moved
  token = setup.token;
  offer(setup.points); // of this start of the server: its rows may be others
}

let looked = false;

// The first look is at a point where something is wrong, if there is one; then it is the reader's choice.
function lookWhere({ points }) {
  if (looked || !byId("point").querySelector("input")) return;
  looked = true;
  const odd = points.find((one) => !["within", "unknown"].includes(one.condition));
  const choice = odd && byId("point").querySelector(`[value="${CSS.escape(odd.point)}"]`);
  if (choice && !choice.checked) {
    choice.checked = true;
    choose(odd.point);
  }
}

function show(now) {
  lookWhere(now);
  showVerdict(now);
  showOperation(now);
  showLevels(now);
  takeLimits(now);
  showDrives(now);
  showNodes(now);
}

startTrend();
const drawWaterfall = startWaterfall();
const drawSpectrum = startSpectrum(drawWaterfall);
startEvents();
startPages();
onRows(() => [drawSpectrum(), drawWaterfall()]);
byId("point").addEventListener("change", (event) => choose(event.target.value));
const sections = { setup: setUp, now: show, spectra: takeRow, hour: takeTrend, day: takeTrend, week: takeTrend, events: takeEvents };
connect(sections, showLost);
