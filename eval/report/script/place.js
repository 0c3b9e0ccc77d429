// Where the reader is, as the URL's hash says it: an entry, an episode, a time; or what is watched;
// and, after "~", what the matrix shows.
const ENTRY = /^r(\d+)c(\d+)(?:s(\d+)e(\d+))?(?:t([\d.]+))?$/;
const WATCHED = /^w(\d+)(?:o([\d.]+?))?(?:a(-?[\d.]+))?(?:t([\d.]+))?$/;
const VIEWED = /^(?:m(\d+))?(?:g([\d.]+))?(?:d([\d.]+))?$/;

const whole = (text) => (Number.isFinite(Number(text)) ? Number(text) : null);
const listed = (text) => (text ? text.split(".").map(Number) : null);

function placeOf(hash) {
  const [text] = hash.replace(/^#/, "").split("~");
  const entry = ENTRY.exec(text);
  if (entry) {
    const [r, c, s, e, t] = entry.slice(1).map(whole);
    return { kind: "entry", r, c, s, e, t };
  }
  const watched = WATCHED.exec(text);
  if (watched) {
    const [, lead, on, value, t] = watched;
    return { kind: "watch", lead: Number(lead), on: listed(on), value: whole(value), t: whole(t) };
  }
  return { kind: "page", id: decoded(text) };
}

function decoded(text) {
  try { return decodeURIComponent(text); } catch { return text; }
}

// The measure that the matrix shows, and the groups and steps that it does not; null: not said.
function viewOf(hash) {
  const [, text] = hash.split("~");
  const found = text === undefined ? null : VIEWED.exec(text);
  return found && { measure: Number(found[1] || 0), groups: listed(found[2]) || [], steps: listed(found[3]) || [] };
}
const viewHash = ({ measure, groups, steps }) => (measure ? `m${measure}` : "") +
  (groups.length ? `g${groups.join(".")}` : "") + (steps.length ? `d${steps.join(".")}` : "");

const timed = (t) => (t ? `t${Number(t.toFixed(3))}` : "");
const entryHash = ({ r, c, s, e, t }) =>
  `#r${r}c${c}${s === null || s === undefined ? "" : `s${s}e${e}`}${timed(t)}`;
const watchHash = (lead, on, t, value = null) =>
  `#w${lead}o${on.join(".")}${value === null ? "" : `a${Number(value.toFixed(4))}`}${timed(t)}`;

// The place alone, without what the matrix shows.
const placeHash = () => location.hash.split("~")[0].replace(/^#$/, "");
let viewed = "";
function remember(hash) {
  const text = (hash || (viewed ? "#" : "")) + (viewed ? `~${viewed}` : "");
  history.replaceState(null, "", text || location.pathname);
}
function rememberView(view) {
  viewed = viewHash(view);
  remember(placeHash());
}
