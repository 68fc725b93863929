// What happened, the newest first; who has seen it, and what was found.

import { byId, cells, element, fill, moment, number, say } from "./dom.js";

const FIRST = 10;
let [events, setup, shown, asked] = [[], null, FIRST, null];

function seen(event) {
  const cell = element("td", { class: "text" });
  if (event.acknowledged_by) {
    cell.append(`${event.acknowledged_by}, ${moment(event.acknowledged)}`);
    if (event.comment) cell.append(element("br"), element("span", { class: "quiet" }, event.comment));
  } else if (setup?.acknowledging && event.id !== null) {
    const button = element("button", { type: "button", "aria-label": `Acknowledge event ${event.id}: ${event.kind} ${event.point}` }, "Acknowledge");
    button.addEventListener("click", () => ask(event));
    cell.append(button);
  } else {
    cell.append("–");
  }
  return cell;
}

function where({ ring, chainage, rock_class: rock, shift }) {
  const parts = [
    ring !== null && `ring ${ring}`, chainage !== null && `${number(chainage, 6)} m`, rock !== null && `rock ${rock}`, shift !== null && `shift ${shift}`,
  ];
  return parts.filter(Boolean).join(", ");
}

function what(event) {
  const cell = element("td", { class: "text" }, event.text);
  const more = [event.verdict && `verdict: ${event.verdict}`, event.level, where(event), event.snapshot && `recording: ${event.snapshot}`];
  const text = more.filter(Boolean).join(" · ");
  if (text) cell.append(element("br"), element("span", { class: "quiet" }, text));
  return cell;
}

function show() {
  const newest = events.toReversed();
  const standing = events.filter((one) => !one.end).length;
  const open = events.filter((one) => !one.acknowledged_by).length;
  say(byId("events-note"), events.length ? `${standing} standing, ${open} not acknowledged` : "nothing has happened yet");
  const rows = newest.slice(0, shown).map((event) =>
    element(
      "tr",
      { "data-standing": !event.end },
      element("td", {}, element("time", { datetime: event.begin }, moment(event.begin))),
      ...cells(event.end ? moment(event.end) : element("strong", {}, "stands"), event.kind, event.point || "–", what(event), seen(event)),
    ),
  );
  fill(byId("events"), rows);
  byId("more").hidden = newest.length <= shown;
}

function ask(event) {
  asked = event;
  say(byId("ack-what"), `${moment(event.begin)} ${event.kind} ${event.point}: ${event.text}`);
  say(byId("ack-problem"), "");
  byId("ack-comment").value = "";
  byId("ack").showModal();
}

async function send(submitted) {
  submitted.preventDefault();
  const body = { id: asked.id, by: byId("ack-by").value.trim(), comment: byId("ack-comment").value.replaceAll(/\s+/g, " ").trim() };
  const headers = { "Content-Type": "application/json", "X-Tbm-Token": setup.token };
  try {
    const answer = await fetch("/events", { method: "POST", headers, body: JSON.stringify(body) });
    if (!answer.ok) {
      say(byId("ack-problem"), await answer.text());
      return;
    }
    const changed = await answer.json();
    events = events.map((event) => (event.id === changed.id ? changed : event));
    byId("ack").close();
    show();
  } catch {
    say(byId("ack-problem"), "no connection: nothing was written");
  }
}

export function takeEvents(content) {
  if (JSON.stringify(content.events) === JSON.stringify(events)) return; // a button that has the focus stays
  events = content.events;
  show();
}

export function startEvents() {
  byId("ack").querySelector("form").addEventListener("submit", send);
  byId("ack-cancel").addEventListener("click", () => byId("ack").close());
  byId("more").addEventListener("click", () => {
    shown += FIRST;
    show();
  });
}

export function allow(given) {
  const changed = setup?.acknowledging !== given.acknowledging;
  setup = given;
  if (changed) show();
}
