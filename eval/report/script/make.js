// Elements, numbers and the words for outcomes.
const SVG = "http://www.w3.org/2000/svg";
const still = matchMedia("(prefers-reduced-motion: reduce)");

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value === null || value === undefined || value === false) continue;
    element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...(children || []).flat(Infinity).filter((child) => child !== null));
  return element;
}
const make = (tag, attributes, ...children) =>
  fill(document.createElement(tag), attributes, children);
// A sentence, with what stands between backticks as code.
const quoted = (text) => text.split("`").map((part, k) => (k % 2 ? make("code", {}, part) : part));
const draw = (tag, attributes, ...children) =>
  fill(document.createElementNS(SVG, tag), attributes, children);

const known = (value) => value !== null && Number.isFinite(value);
function joules(value, digits = 2) {
  if (!known(value)) return "not known";
  const text = Math.abs(value) < 1e5 ? value.toFixed(digits) : value.toExponential(2);
  const zero = Number(text) === 0;
  return `${zero ? "" : value < 0 ? "−" : "+"}${text.replace("-", "")} J`;
}
const spaced = (label) => label.replaceAll("_", " ");

const SIGNS = {
  none: "✓", discretization_error: "D", control_error: "C", planning_error: "P",
  not_learned: "N", too_slow: "S", unachievable: "U", evaluation_error: "E",
  perception_error: "O", state_error: "L", unattributed: "?",
};
const signOf = (label) => SIGNS[label] || "✕";
const wordOf = (label) => (label === "none" ? "succeeds" : "fails");
