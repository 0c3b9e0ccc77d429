// Brings the page to life, and goes where the URL says.
async function begin() {
  const carried = await unpack(document.getElementById("carried").textContent);
  const matrix = document.querySelector(".matrixcard");
  const grid = matrix ? new Grid(carried, matrix) : null;
  const watched = document.getElementById("watch-card");
  const watch = watched && carried.leads.length ? new Watch(carried, watched) : null;
  const drawer = new Drawer(carried, document.getElementById("drawer"),
    () => { if (watch) watch.player.pause(); });
  // On a phone what moves comes before the words on the task.
  const task = document.querySelector(".task");
  if (watch && task && innerWidth <= 640) watched.parentElement.after(task);
  for (const svg of document.querySelectorAll("[data-scene]")) showTask(carried, svg);
  const went = () => {
    const view = viewOf(location.hash);
    if (grid && view) grid.view(view);
    else if (viewed) remember(placeHash());
    const place = placeOf(location.hash);
    if (place.kind === "entry" && drawer.open(place)) return;
    const led = drawer.dialog.open && place.kind === "watch";
    if (place.id === "") drawer.dialog.close();
    else drawer.leave();
    if (place.kind === "watch" && watch) {
      watch.open(place.lead, place.on, place.t, place.value);
      if (led) watch.focus();
      watched.scrollIntoView();
    }
  };
  document.querySelectorAll("ul.forest, ul.findings, table.data").forEach(walkable);
  const policies = document.getElementById("policies");
  policies.addEventListener("toggle", () => listPolicies(carried, policies), { once: true });
  if (watch) watch.open(0);
  addEventListener("hashchange", went);
  // A second visit of the same cell changes no hash.
  document.addEventListener("click", (event) => {
    const link = event.target.closest('a[href^="#r"]');
    if (link && link.hash === placeHash()) went();
  });
  went();
  if (watch && placeOf(location.hash).kind !== "watch") watch.startWhenSeen();
  document.documentElement.dataset.ready = performance.now().toFixed(0);
}

// The task before anything moves.
function showTask(carried, holder) {
  const stage = new Stage(carried, carried.scene, null);
  const { bob, pose } = carried.scene;
  stage.pose(bob ? [0.35 * bob.pivot, 0.1] : pose, carried.scene.limits.map(() => 0.9));
  holder.append(stage.svg);
}

begin();
