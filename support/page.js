(function () {
  function reveal() {
    var id = location.hash.slice(1);
    try { id = decodeURIComponent(id); } catch (error) { /* not encoded: taken as it stands */ }
    var target = id && document.getElementById(id);
    if (!target) { return; }
    var box = target.closest("details");
    if (box && !box.open) { box.open = true; target.scrollIntoView(); }
  }
  addEventListener("hashchange", reveal);
  reveal();
  var opened = [];
  addEventListener("beforeprint", function () {
    opened = Array.from(document.querySelectorAll("details:not([open])"));
    opened.forEach(function (box) { box.open = true; });
  });
  addEventListener("afterprint", function () {
    opened.forEach(function (box) { box.open = false; });
  });
  document.querySelectorAll("pre.command").forEach(copyable);
})();
function copyable(block) {
  if (!navigator.clipboard) { return; }
  var button = document.createElement("button");
  button.type = "button";
  button.textContent = "copy";
  button.addEventListener("click", function () {
    navigator.clipboard.writeText(block.textContent).then(function () {
      button.textContent = "copied";
      setTimeout(function () { button.textContent = "copy"; }, 1500);
    }, function () { getSelection().selectAllChildren(block); });
  });
  block.parentElement.appendChild(button);
}
