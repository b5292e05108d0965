// Runs in /view/ before viser's own client. CONFIG is put in by server/view3d/page.py.
"use strict";
(() => {
  const CONFIG = __NAVDECK_CONFIG__;
  const query = new URLSearchParams(location.search);
  const wishes = {
    board: query.get("board") || "",
    camera: CONFIG.cameras[query.get("camera")] ? query.get("camera") : "chase",
    color: CONFIG.colors.includes(query.get("color")) ? query.get("color") : "speed",
    scene: query.get("scene") === "calibration" ? "calibration" : "flight",
    theme: query.has("darkMode") ? "dark" : query.get("theme") === "dark" ? "dark" : "light",
  };

  // viser reconnects only while its page has the focus; an iframe in the corner of our page never has.
  Document.prototype.hasFocus = () => true;

  // The first frame already looks the right way.
  const start = wishes.scene === "calibration" ? CONFIG.studio : CONFIG.cameras[wishes.camera];
  const set = (name, value) => query.has(name) || query.set(name, value);
  set("initialCameraPosition", start.position.join(","));
  set("initialCameraLookAt", start.target.join(","));
  set("initialCameraUp", "0,0,1");
  set("initialCameraFov", CONFIG.fov);
  set("initialCameraNear", CONFIG.near);
  set("initialCameraFar", CONFIG.far);
  set("hideViserLogo", "");
  query.delete("websocket");
  query.delete("playbackPath");
  history.replaceState(null, "", "?" + [...query].map(([k, v]) => `${k}=${v}`).join("&"));

  const paint = () => document.documentElement.setAttribute("data-theme", wishes.theme);
  paint();

  // viser's socket lives in a worker: send it to our proxy with the wishes, and send commands through the same socket.
  let worker = null;
  const post = Worker.prototype.postMessage;
  const server = () =>
    `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${CONFIG.path}?${new URLSearchParams(wishes)}`;
  const command = (fields) => {
    if (worker) post.call(worker, { type: "send", message: { type: "NavdeckViewCommand", ...fields } });
  };
  Worker.prototype.postMessage = function (data, ...rest) {
    if (data && data.type === "set_server") {
      data = { ...data, server: server() };
      if (worker !== this) {
        worker = this;
        this.addEventListener("message", (event) => {
          if (event.data && event.data.type === "connected")
            command({ ...wishes, resume: true, visible: document.visibilityState !== "hidden" });
        });
      }
    }
    return post.call(this, data, ...rest);
  };

  const obey = (wanted) => {
    const changed = {};
    for (const key of ["board", "camera", "color", "theme", "scene"])
      if (typeof wanted[key] === "string") changed[key] = wishes[key] = wanted[key];
    if (wanted.fit === true) {
      changed.fit = true;
      if (wishes.scene === "flight") wishes.camera = "free";
    }
    paint();
    command(changed);
  };
  const tell = () =>
    parent !== window && parent.postMessage({ navdeck: "view", camera: wishes.camera }, location.origin);

  addEventListener("message", (event) => {
    if (event.origin === location.origin && event.data && event.data.navdeck === "view") obey(event.data);
  });
  document.addEventListener("visibilitychange", () =>
    command({ visible: document.visibilityState !== "hidden" }),
  );
  // One key each; viser's own letters (W A S D Q E) move the camera, and its command palette stays shut.
  const keys = { 1: { camera: "chase" }, 2: { camera: "follow" }, 3: { camera: "top" }, 4: { camera: "free" }, f: { fit: true } };
  addEventListener(
    "keydown",
    (event) => {
      if (event.ctrlKey || event.metaKey) event.stopImmediatePropagation();
      else if (keys[event.key] && (wishes.scene === "flight" || keys[event.key].fit)) {
        obey(keys[event.key]);
        tell();
      }
    },
    true,
  );
})();
