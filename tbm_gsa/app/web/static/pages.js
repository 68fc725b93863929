// Links to the pages of studies, explanations and comparisons.

import { byId, element, moment } from "./dom.js";

const EVERY_MS = 60000;

async function look() {
  try {
    const answer = await fetch("/pages");
    if (!answer.ok) return;
    const { pages } = await answer.json();
    const items = pages.map((page) =>
      element(
        "li",
        {},
        element("a", { href: `/pages/${page.key}` }, page.title),
        element("span", { class: "quiet" }, ` ${page.file}, ${moment(page.written)}`),
      ),
    );
    byId("pages").replaceChildren(...(items.length ? items : [element("li", { class: "quiet" }, "none in the run's folder yet")]));
  } catch {
    // the connection is lost: the next look
  }
}

export function startPages() {
  look();
  setInterval(look, EVERY_MS);
}
