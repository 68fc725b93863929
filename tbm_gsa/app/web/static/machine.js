// The machine from the side with its test points, and the level of each beside what is expected.

import { byId, cells, element, fill, number, say, svg } from "./dom.js";

const WORDS = {
  within: "as expected", above: "above", below: "below", dead: "dead", silent: "silent", faulty: "faulty", unknown: "no limits yet",
};

export function drawMachine({ picture, points, title }) {
  const { shapes, places } = picture;
  const ends = shapes.map((one) => [one.x, one.x + one.width, one.y, one.y + one.height]);
  const [left, right] = [Math.min(...ends.map((one) => one[0])), Math.max(...ends.map((one) => one[1]))];
  const [low, high] = [Math.min(...ends.map((one) => one[2])), Math.max(...ends.map((one) => one[3]))];
  const edge = 0.03 * (right - left);
  const radius = 0.032 * (right - left);
  const drawing = byId("picture");
  drawing.setAttribute("viewBox", [left - edge, -high - edge, right - left + 2 * edge, high - low + 2 * edge].join(" "));
  drawing.setAttribute("aria-label", `${title}, from the side: ${points.join(", ")} from the face to the rear`);
  const boxes = shapes.map((one) =>
    svg("rect", {
      class: one.kind, x: one.x, y: -one.y - one.height, width: Math.max(one.width, edge / 3), height: one.height,
      rx: edge / 4, "vector-effect": "non-scaling-stroke",
    }),
  );
  const marks = places.map(({ point, x, y }) =>
    svg(
      "g",
      { "data-point": point },
      svg("title", {}, point),
      svg("circle", { cx: x, cy: -y, r: radius }),
      svg("text", { x, y: -y, "font-size": radius * 1.2 }, String(points.indexOf(point) + 1)),
    ),
  );
  drawing.replaceChildren(...boxes, ...marks);
}

function bar({ measured, computed, expected }) {
  const made = element("div", { class: "bar", "aria-hidden": "true" });
  const top = 1.25 * Math.max(measured ?? 0, computed ?? 0, expected.high ?? 0);
  if (!top) return made;
  const percent = (value) => `${(100 * Math.min(value, top)) / top}%`;
  if (expected.high !== null) {
    const band = element("i", { class: "within" });
    [band.style.left, band.style.width] = [percent(expected.low), percent(expected.high - expected.low)];
    made.append(band);
  }
  if (measured !== null) {
    const level = element("i", { class: "level" });
    level.style.left = percent(measured);
    made.append(level);
  }
  return made;
}

export function showLevels(now) {
  say(byId("expected"), `Expected: ${now.limits_are}.`);
  for (const mark of byId("picture").querySelectorAll("[data-point]")) {
    mark.dataset.state = now.points.find((one) => one.point === mark.dataset.point)?.condition ?? "unknown";
  }
  fill(
    byId("levels"),
    now.points.map((one, place) => {
      const { low, high } = one.expected;
      const band = high === null ? "–" : `${number(low, 2)} – ${number(high, 2)}`;
      const words = one.condition === "within" ? undefined : one.text;
      return element(
        "tr",
        { title: words },
        element("th", { scope: "row" }, element("span", { class: "number", "aria-hidden": "true" }, String(place + 1)), one.point),
        element("td", { class: "state", "data-state": one.condition }, one.condition === "unknown" && one.measured === null ? "no window" : WORDS[one.condition]),
        element("td", { class: "wide" }, bar(one)),
        ...cells(number(one.measured), band, number(one.computed)),
      );
    }),
  );
}
