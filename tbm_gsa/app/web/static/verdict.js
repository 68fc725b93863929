// The verdict in words, since when; how the machine is driven; the nodes.

import { ago, byId, cells, element, fill, moment, number, say } from "./dom.js";

const SIGNS = { well: "✓", learning: "…", still: "II", rock: "~", level: "±", sensor: "?", machine: "!", no_data: "×" };

export function showVerdict(now) {
  const { kind, title, text, since, also } = now.verdict;
  byId("verdict").dataset.kind = kind;
  say(byId("sign"), SIGNS[kind]);
  say(byId("title"), title);
  say(byId("text"), text);
  say(byId("since"), since ? `since ${moment(since)} (${ago(since)})` : "");
  const list = byId("also");
  if (list.dataset.shown !== also.join("\n")) {
    list.dataset.shown = also.join("\n");
    list.replaceChildren(...also.map((one) => element("li", {}, one)));
  }
  document.title = `${title} – ${byId("name").textContent}`;
}

// What was said last may be wrong by now: it is no verdict any more.
export function showLost(since) {
  const before = byId("title").textContent;
  byId("verdict").dataset.kind = "no_data";
  say(byId("sign"), SIGNS.no_data);
  say(byId("title"), "No connection to the monitor");
  say(byId("text"), `Before: ${before}`);
  say(byId("since"), `since ${moment(since)}`);
  document.title = `No connection – ${byId("name").textContent}`;
}

export function showOperation({ operation, context }) {
  const names = { ring: "ring", chainage: "chainage", rock_class: "rock class", shift: "shift" };
  const driven = operation
    ? [`${number(operation.speed_r_min)} r/min`, `${number(operation.torque_kn_m, 4)} kN·m`, `${number(operation.thrust_kn, 5)} kN`]
    : ["operating point not known"];
  const said = Object.entries(context).map(([key, value]) => `${names[key]} ${value}${key === "chainage" ? " m" : ""}`);
  say(byId("operation"), [...driven, ...said].join(" · "));
}

export function showNodes(now) {
  fill(
    byId("nodes"),
    now.nodes.map((node) =>
      element(
        "tr",
        {},
        element("th", { scope: "row" }, node.name),
        element("td", { class: "text state", "data-state": node.condition }, node.condition),
        element("td", { class: "text" }, node.text),
        ...cells(node.heard ? moment(node.heard) : "never"),
      ),
    ),
  );
  const lines = { Machine: now.machine, Rock: now.rock };
  byId("watch").replaceChildren(
    ...Object.entries(lines).flatMap(([name, text]) => [element("dt", {}, name), element("dd", {}, text || "nothing heard yet")]),
  );
  say(byId("study"), now.study ? `Sensitivity analysis: ${now.study}` : "");
}
