// What a reader would see, asked of a page by tests.
window.looking = {
  // Focused or not, what lies on top of an element at its middle and near its corners?
  covered(element) {
    const box = element.getBoundingClientRect();
    const points = [[0.5, 0.5], [0.15, 0.5], [0.85, 0.5], [0.5, 0.15], [0.5, 0.85]];
    return points.some(([x, y]) => {
      const top = document.elementFromPoint(box.left + x * box.width, box.top + y * box.height);
      return !top || !(element.contains(top) || top.contains(element));
    });
  },
  // Headers of tables whose text is wider than they are, or reaches into the next.
  cut() {
    return [...document.querySelectorAll("th")].filter((head) =>
      head.offsetParent && head.scrollWidth > head.clientWidth + 1).map((head) => head.textContent.trim());
  },
  // Texts whose contrast with what is behind them is below a bound.
  faint(bound) {
    const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
    const channels = (colour) => {
      canvas.clearRect(0, 0, 1, 1);
      canvas.fillStyle = colour;
      canvas.fillRect(0, 0, 1, 1);
      const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
      return [r, g, b, a / 255];
    };
    const over = (top, below) => top.slice(0, 3).map((c, k) => top[3] * c + (1 - top[3]) * below[k]);
    const behind = (element) => {
      const layers = [];
      for (let one = element; one; one = one.parentElement) {
        const colour = channels(getComputedStyle(one).backgroundColor);
        layers.push(colour);
        if (colour[3] > 0.999) break;
      }
      return layers.reverse().reduce((below, top) => over(top, below), [255, 255, 255]);
    };
    const light = (rgb) => rgb.map((c) => c / 255)
      .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
      .reduce((sum, c, k) => sum + [0.2126, 0.7152, 0.0722][k] * c, 0);
    const found = new Set();
    const walker = document.createTreeWalker(document.querySelector("dialog[open]") || document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
      const element = walker.currentNode.parentElement;
      if (!walker.currentNode.data.trim() || !element.offsetParent || element.closest("script, style, svg, .hidden")) continue;
      const ground = behind(element);
      const style = getComputedStyle(element);
      const ink = over(channels(style.color), ground);
      const [low, high] = [light(ink), light(ground)].sort((a, b) => a - b);
      if ((high + 0.05) / (low + 0.05) < bound) found.add(`${element.tagName}.${element.className}: ${walker.currentNode.data.trim().slice(0, 30)}`);
    }
    return [...found];
  },
};
