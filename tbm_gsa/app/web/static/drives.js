// The share of each drive in the torque, and its largest tooth force.

import { byId, cells, element, fill, number } from "./dom.js";

function bar({ computed, measured }, most) {
  const made = element("div", { class: "bar", "aria-hidden": "true" });
  const add = (name, property, value) => {
    const part = element("i", { class: name });
    part.style[property] = `${(100 * Math.max(0, Math.min(value, most))) / most}%`;
    made.append(part);
  };
  if (computed !== null) add("share", "width", computed);
  add("one", "left", 1);
  if (measured !== null) add("level", "left", measured);
  return made;
}

export function showDrives({ drives }) {
  const most = Math.max(1.5, ...drives.flatMap((one) => [one.computed ?? 0, one.measured ?? 0])) * 1.05;
  const percent = (value) => (value === null ? "–" : `${number(100 * value)} %`);
  const rows = drives.map((one) =>
    element(
      "tr",
      {},
      element("th", { scope: "row" }, one.drive.replace("_", " ")),
      ...cells(element("td", { class: "wide" }, bar(one, most)), percent(one.computed), percent(one.measured), number(one.tooth_force_kn)),
    ),
  );
  const nothing = element("tr", {}, element("td", { colspan: "5" }, "nothing is heard of the drives"));
  fill(byId("drives"), rows.length ? rows : [nothing]);
}
