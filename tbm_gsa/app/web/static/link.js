// The connection: sections as they come; after a loss again and again, less and less often.

import { byId, moment, say } from "./dom.js";

const FIRST_MS = 500;
const LONGEST_MS = 15000;
const SILENT_MS = 10000; // something comes every second

export function connect(handlers) {
  let wait = FIRST_MS;
  let heard = null;
  let timer = 0;
  let server = null; // its word: another one is another start of the server

  function lost() {
    document.body.dataset.stale = "";
    byId("link").dataset.lost = "";
    say(byId("link"), `no connection since ${heard ? moment(heard) : "the page was opened"}`);
  }

  function receive(event) {
    heard = new Date();
    wait = FIRST_MS;
    const { section, content } = JSON.parse(event.data);
    if (section === "setup") {
      if (server && server.version !== content.version) location.reload();
      server = content;
    }
    if ("lost" in byId("link").dataset || "stale" in document.body.dataset) {
      delete document.body.dataset.stale;
      delete byId("link").dataset.lost;
    }
    say(byId("link"), "live");
    handlers[section]?.(content);
  }

  function open() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    const watch = setInterval(() => {
      if (heard && Date.now() - heard > SILENT_MS) socket.close();
    }, 1000);
    socket.onmessage = receive;
    socket.onclose = () => {
      clearInterval(watch);
      lost();
      clearTimeout(timer);
      timer = setTimeout(open, wait * (0.75 + Math.random() / 2));
      wait = Math.min(2 * wait, LONGEST_MS);
    };
  }

  // Somebody comes back to the page, or the network does: no need to wait.
  for (const name of ["online", "focus"]) {
    addEventListener(name, () => {
      if ("lost" in byId("link").dataset) {
        wait = FIRST_MS;
      }
    });
  }
  open();
}
