// Where the reader is, as the URL's hash says it: an entry, an episode, a time; or what is watched.
const ENTRY = /^r(\d+)c(\d+)(?:s(\d+)e(\d+))?(?:t([\d.]+))?$/;
const WATCHED = /^w(\d+)(?:o([\d.]+?))?(?:t([\d.]+))?$/;

function placeOf(hash) {
  const text = hash.replace(/^#/, "");
  const entry = ENTRY.exec(text);
  if (entry) {
    const [r, c, s, e, t] = entry.slice(1).map((x) => (x === undefined ? null : Number(x)));
    return { kind: "entry", r, c, s, e, t };
  }
  const watched = WATCHED.exec(text);
  if (watched) {
    const [, lead, on, t] = watched;
    return { kind: "watch", lead: Number(lead), on: on ? on.split(".").map(Number) : null,
      t: t === undefined ? null : Number(t) };
  }
  return { kind: "page", id: decodeURIComponent(text) };
}

const timed = (t) => (t ? `t${Number(t.toFixed(3))}` : "");
const entryHash = ({ r, c, s, e, t }) =>
  `#r${r}c${c}${s === null || s === undefined ? "" : `s${s}e${e}`}${timed(t)}`;
const watchHash = (lead, on, t) => `#w${lead}o${on.join(".")}${timed(t)}`;
const remember = (hash) => history.replaceState(null, "", hash || location.pathname);
