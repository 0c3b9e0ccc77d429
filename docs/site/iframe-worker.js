/* Search from the file system: browsers refuse workers there, so a hidden frame does their work. */
"use strict";
if (location.protocol === "file:") {
  window.IFrameWorker = class extends EventTarget {
    constructor(url) {
      super();
      this.onmessage = this.onerror = null;
      this.waiting = [];
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      const inside = frame.contentWindow;
      inside.document.open();
      inside.document.write("<!doctype html><title>worker</title>");
      inside.document.close();
      inside.postMessage = (data) => this.tell(data);
      inside.importScripts = (...scripts) =>
        Promise.all(scripts.map((script) => load(inside.document, new URL(script, url))));
      load(inside.document, url).then(() => {
        this.frame = inside;
        this.waiting.splice(0).forEach((data) => this.postMessage(data));
      });
    }
    postMessage(data) {
      if (!this.frame) {
        this.waiting.push(data);
        return;
      }
      this.frame.dispatchEvent(new this.frame.MessageEvent("message", { data }));
    }
    tell(data) {
      const event = new MessageEvent("message", { data });
      if (this.onmessage) this.onmessage(event);
      this.dispatchEvent(event);
    }
    terminate() {}
  };
  window.Worker = window.IFrameWorker;
}
function load(page, url) {
  return new Promise((done, failed) => {
    const script = page.createElement("script");
    script.src = url;
    script.onload = done;
    script.onerror = failed;
    page.body.append(script);
  });
}
