// Every policy with its file and hash, when somebody asks.
function listPolicies(carried, box) {
  const heads = ["row", "seed", "policy", "hash"].map((name) => make("th", { scope: "col" }, name));
  const lines = carried.rows.flatMap((row) => row.policies.map(({ id, seed, hash, file }) =>
    make("tr", {}, make("th", { scope: "row" }, row.shown), make("td", {}, seed ?? "–"),
      make("td", {}, file ? make("a", { href: file }, id) : id),
      make("td", {}, make("code", {}, hash || "–")))));
  box.querySelector(".scroll").append(make("table", { class: "data" },
    make("thead", {}, make("tr", {}, heads)), make("tbody", {}, lines)));
}
