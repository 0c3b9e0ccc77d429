// A list of comparisons is one stop of the Tab key; arrow keys lead from line to line.
function walkable(forest) {
  const links = [...forest.querySelectorAll("a")];
  links.forEach((link, place) => { link.tabIndex = place ? -1 : 0; });
  forest.addEventListener("focusin", ({ target }) => {
    for (const link of links) link.tabIndex = link === target ? 0 : -1;
  });
  forest.addEventListener("keydown", (event) => {
    const at = links.indexOf(event.target);
    const next = { ArrowUp: at - 1, ArrowDown: at + 1, Home: 0, End: links.length - 1 }[event.key];
    if (next === undefined || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    if (links[next]) links[next].focus();
  });
}
