"use strict";
// Numbers as people read them, tables as programs read them.

const minus = (text) => String(text).replace(/-/g, "−");
const superscript = (e) => minus(e).replace(/[−0-9]/g, (c) => c === "−" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(c)]);
const isNumber = (v) => typeof v === "number" && Number.isFinite(v);
const exponent = (v) => v === 0 ? 0 : Math.floor(Math.log10(Math.abs(v)) + 1e-12);
// Small and large numbers get a power of ten, not a row of zeros.
const powerFor = (largest) => {
  const e = exponent(largest);
  return e < -2 || e > 4 ? e : 0;
};

// With so many significant digits.
function shown(value, digits = 3) {
  if (!isNumber(value)) return "–";
  const v = Number(value.toPrecision(digits));  // first, or 99.97 becomes 100.0
  if (v === 0) return "0";
  const e = powerFor(v);
  if (e === 0) return minus(v.toFixed(Math.min(12, Math.max(0, digits - 1 - exponent(v)))));
  return `${minus((v / 10 ** e).toFixed(digits - 1))}×10${superscript(e)}`;
}

// Value ± error, with two digits of the error.
function withError(v, error) {
  if (!isNumber(v)) return "–";
  if (!isNumber(error) || error <= 0) return shown(v, 4);
  const e = powerFor(v), s = 10 ** e;
  const digits = Math.min(12, Math.max(0, 1 - exponent(error / s)));
  const text = `${minus((v / s).toFixed(digits))} ± ${(error / s).toFixed(digits)}`;
  return e === 0 ? text : `(${text})×10${superscript(e)}`;
}

const thetaText = (theta) => theta.map((v) => minus(v)).join(", ");
const place = (s) => `y = ${minus(s.y_mm)} mm, ${minus(s.angle_deg)}°`;
const plural = (n, noun) => `${n} ${noun}${n === 1 ? "" : "s"}`;

// One power of ten for an axis: values are divided by `scale`, and the unit says so.
function axisScale(values, name, unit) {
  const largest = values.filter(isNumber).reduce((a, v) => Math.max(a, Math.abs(v)), 0);
  const e = powerFor(largest);
  const parts = [e === 0 ? "" : `10${superscript(e)}`, unit].filter((s) => s !== "").join(" ");
  return {scale: 10 ** e, title: parts === "" ? `${name} [–]` : `${name} [${parts}]`};
}

function duration(seconds) {
  if (seconds < 100) return `${seconds.toFixed(1)} s`;
  if (seconds < 5400) return `${Math.floor(seconds / 60)} min`;
  return `${Math.floor(seconds / 3600)} h ${Math.floor(seconds / 60) % 60} min`;
}

// Rows of a table, the first one its header, as RFC 4180 has them.
function csvText(rows) {
  const field = (v) => v === null || v === undefined ? "" : /[",\r\n]/.test(String(v)) ? `"${String(v).replace(/"/g, '""')}"` : String(v);
  return rows.map((row) => row.map(field).join(",") + "\n").join("");
}

function download(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], {type: "text/csv"}));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
