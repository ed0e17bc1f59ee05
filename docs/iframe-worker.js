// SPDX-License-Identifier: GPL-3.0-or-later
// Search on pages that are opened from a folder. Browsers start no workers there, so the search runs in a hidden frame,
// from when somebody turns to the search field on: until then a page costs nothing.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = []; // messages until the frame's script is loaded
      const begin = (event) => {
        if (!event.target.matches('[data-md-component="search-query"]')) return;
        document.removeEventListener("focusin", begin);
        this.begin(url);
      };
      document.addEventListener("focusin", begin);
    }

    begin(url) {
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.title = "search";
      document.body.appendChild(frame);
      const inside = frame.contentWindow;
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      const script = frame.contentDocument.createElement("script");
      script.src = url;
      script.onload = () => {
        this.inside = inside;
        this.waiting.splice(0).forEach((data) => this.postMessage(data));
      };
      frame.contentDocument.body.appendChild(script);
    }

    postMessage(data) {
      if (this.inside) this.inside.dispatchEvent(new MessageEvent("message", { data }));
      else this.waiting.push(data);
    }
  };
}
