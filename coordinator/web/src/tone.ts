// How layers become colours on the screen.
import { halfValues, kHalves } from "./halves.ts";

export type Curve = "clamp" | "filmic" | "reinhard";
export const kCurves: { value: Curve; label: string }[] = [
  { value: "clamp", label: "Clamp (as the PNG)" },
  { value: "filmic", label: "Filmic" },
  { value: "reinhard", label: "Reinhard" },
];

/** One layer as it came: `rgb` holds half floats, three a pixel. */
export interface Pixels {
  width: number;
  height: number;
  passes: number;
  rgb: Uint16Array;
}

/** The sRGB curve of IEC 61966-2-1. */
const encode = (v: number): number => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);

function mapped(v: number, curve: Curve): number {
  if (curve === "reinhard") return v / (1 + v);
  // Narkowicz 2015, a fit of the ACES curve.
  if (curve === "filmic") return (v * (2.51 * v + 0.03)) / (v * (2.43 * v + 0.59) + 0.14);
  return v;
}

/** 8-bit values of all halves. */
export function toneTable(exposure: number, curve: Curve): Uint8ClampedArray {
  const scale = 2 ** exposure;
  const table = new Uint8ClampedArray(kHalves);
  for (let bits = 0; bits < kHalves; ++bits) {
    const v = Math.max(0, halfValues[bits] ?? 0) * scale;
    table[bits] = v === Infinity ? 255 : 255 * encode(Math.min(1, Math.max(0, mapped(v, curve))));
  }
  return table;
}

const isNaNHalf = (bits: number): boolean => (bits & 0x7c00) === 0x7c00 && (bits & 0x3ff) !== 0;

export function drawTone(pixels: Pixels, table: Uint8ClampedArray, out: Uint8ClampedArray): void {
  const { rgb } = pixels;
  for (let i = 0, o = 0; i < rgb.length; i += 3, o += 4) {
    const r = rgb[i] ?? 0;
    const g = rgb[i + 1] ?? 0;
    const b = rgb[i + 2] ?? 0;
    out[o] = table[r] ?? 0;
    out[o + 1] = table[g] ?? 0;
    out[o + 2] = table[b] ?? 0;
    out[o + 3] = 255;
    // As in the PNG: a pixel with a NaN is seen.
    if (isNaNHalf(r) || isNaNHalf(g) || isNaNHalf(b)) out.set([255, 0, 255], o);
  }
}

/** Directions: -1..1 becomes black..white. */
export function drawNormal(pixels: Pixels, out: Uint8ClampedArray): void {
  for (let i = 0, o = 0; i < pixels.rgb.length; i += 3, o += 4) {
    for (let c = 0; c < 3; ++c) out[o + c] = 127.5 * (1 + (halfValues[pixels.rgb[i + c] ?? 0] ?? 0));
    out[o + 3] = 255;
  }
}

/** Values of one channel, or anything else that a pixel has. */
export function channelOf(pixels: Pixels, channel: number): Float32Array {
  const values = new Float32Array(pixels.width * pixels.height);
  for (let p = 0; p < values.length; ++p) values[p] = halfValues[pixels.rgb[3 * p + channel] ?? 0] ?? 0;
  return values;
}

/**
 * Estimated relative error of each pixel: sqrt(noise^2 + bias^2) over the luminance, weighed as relMSE weighs it
 * (mean of d^2 / (L^2 + 0.01)). `error` holds noise and bias.
 */
export function relativeError(error: Pixels, beauty: Pixels): Float32Array {
  const values = new Float32Array(error.width * error.height);
  for (let p = 0; p < values.length; ++p) {
    const at = (pixels: Pixels, c: number): number => halfValues[pixels.rgb[3 * p + c] ?? 0] ?? 0;
    const luminance = 0.2126 * at(beauty, 0) + 0.7152 * at(beauty, 1) + 0.0722 * at(beauty, 2);
    values[p] = Math.hypot(at(error, 0), at(error, 1)) / Math.sqrt(luminance * luminance + 0.01);
  }
  return values;
}

// Eleven stops each of two perceptually even scales, matplotlib's viridis and inferno (CC0): lightness alone orders them.
const kViridis = "440154 482475 414487 355f8d 2a788e 21918c 22a884 44bf70 7ad151 bddf26 fde725";
const kInferno = "000004 160b39 420a68 6a176e 932667 bc3754 dd513a f37819 fca50a f6d746 fcffa4";
export type ScaleName = "viridis" | "inferno";

function stopsOf(name: ScaleName): number[][] {
  return (name === "viridis" ? kViridis : kInferno)
    .split(" ")
    .map((hex) => [0, 2, 4].map((at) => Number.parseInt(hex.slice(at, at + 2), 16)));
}

export const gradientOf = (name: ScaleName): string =>
  `linear-gradient(to right, ${stopsOf(name).map((rgb) => `rgb(${rgb.join(" ")})`).join(", ")})`;

const kSteps = 1024;
function scaleTable(name: ScaleName): Uint8ClampedArray {
  const stops = stopsOf(name);
  const table = new Uint8ClampedArray(3 * kSteps);
  for (let s = 0; s < kSteps; ++s) {
    const place = (s / (kSteps - 1)) * (stops.length - 1);
    const low = Math.min(stops.length - 2, Math.floor(place));
    for (let c = 0; c < 3; ++c) {
      const from = stops[low]?.[c] ?? 0;
      table[3 * s + c] = from + (place - low) * ((stops[low + 1]?.[c] ?? 0) - from);
    }
  }
  return table;
}

export interface Range {
  low: number;
  high: number;
  logarithmic: boolean;
}

/** What most values lie within; of a logarithmic scale at most three decades. */
export function rangeOf(values: Float32Array, logarithmic: boolean): Range {
  const step = Math.max(1, Math.floor(values.length / 20000));
  const some: number[] = [];
  for (let i = 0; i < values.length; i += step) {
    const v = values[i] ?? NaN;
    if (Number.isFinite(v) && (!logarithmic || v > 0)) some.push(v);
  }
  some.sort((a, b) => a - b);
  const at = (share: number): number => some[Math.round(share * (some.length - 1))] ?? 0;
  const high = at(0.998);
  const low = logarithmic ? Math.max(at(0.01), high / 1000) : at(0.002);
  return high > low ? { low, high, logarithmic } : { low, high: low > 0 ? 2 * low : low + 1, logarithmic };
}

export function drawScale(values: Float32Array, range: Range, name: ScaleName, out: Uint8ClampedArray): void {
  const table = scaleTable(name);
  const map = (v: number): number => (range.logarithmic ? Math.log(Math.max(v, 1e-30)) : v);
  const low = map(range.low);
  const factor = (kSteps - 1) / (map(range.high) - low);
  for (let p = 0, o = 0; p < values.length; ++p, o += 4) {
    const place = 3 * Math.round(Math.min(kSteps - 1, Math.max(0, (map(values[p] ?? 0) - low) * factor)));
    out[o] = table[place] ?? 0;
    out[o + 1] = table[place + 1] ?? 0;
    out[o + 2] = table[place + 2] ?? 0;
    out[o + 3] = 255;
  }
}
