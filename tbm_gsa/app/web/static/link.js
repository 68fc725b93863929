// The connection: sections as they come; after a loss again and again, less and less often.

import { byId, moment, say } from "./dom.js";

const FIRST_MS = 500;
const LONGEST_MS = 15000;
const SILENT_MS = 10000; // something comes every second

export function connect(handlers, lost) {
  let wait = FIRST_MS;
  let heard = Date.now();
  let told = ""; // time of the newest word; the same one again is old, whoever sends it
  let timer = 0;
  let version = null; // of the page's files

  function lose() {
    if ("lost" in byId("link").dataset) return;
    byId("link").dataset.lost = "";
    say(byId("link"), `no connection since ${moment(heard)}`);
    lost(heard);
  }

  function receive(event) {
    const { section, content } = JSON.parse(event.data);
    if (section === "setup") {
      if (version && version !== content.version) location.reload();
      version = content.version;
    }
    if (section === "now") {
      if (content.time === told) return;
      [told, heard, wait] = [content.time, Date.now(), FIRST_MS];
      delete byId("link").dataset.lost;
      say(byId("link"), "live");
    }
    handlers[section]?.(content);
  }

  function open() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    const watch = setInterval(() => {
      if (Date.now() - heard <= SILENT_MS) return;
      lose();
      socket.close();
    }, 500);
    socket.onmessage = receive;
    socket.onclose = () => {
      clearInterval(watch);
      lose();
      clearTimeout(timer);
      timer = setTimeout(open, wait * (0.75 + Math.random() / 2));
      wait = Math.min(2 * wait, LONGEST_MS);
    };
  }

  open();
}
