// The parts of the dashboard that need no browser.
import assert from "node:assert/strict";
import { File } from "node:buffer";
import { createRequire } from "node:module";
import { join } from "node:path";
import { test } from "node:test";

const { PF_WEB_STAGE } = process.env; // the bundler, and the sources as they were bundled
const esbuild = createRequire(join(PF_WEB_STAGE, "package.json"))("esbuild");
globalThis.sessionStorage = { getItem: () => null };

/** What src/NAME.ts exports. */
async function load(name) {
  const entry = join(PF_WEB_STAGE, "src", `${name}.ts`);
  const { outputFiles } = await esbuild.build({ entryPoints: [entry], bundle: true, write: false, format: "esm", target: "es2022" });
  return import(`data:text/javascript;base64,${Buffer.from(outputFiles[0].contents).toString("base64")}`);
}
const { halfValues } = await load("halves");
const tone = await load("tone");
const spec = await load("spec_text");
const format = await load("format");
const files = await load("scene_files");
const { looksOf } = await load("looks");

test("halves are decoded", () => {
  for (const [bits, value] of [[0, 0], [0x3c00, 1], [0xc000, -2], [0x7bff, 65504], [1, 2 ** -24], [0x3555, 0.333251953125]]) {
    assert.equal(halfValues[bits], Math.fround(value));
  }
  assert.equal(halfValues[0x7c00], Infinity);
  assert.ok(Number.isNaN(halfValues[0x7c01]));
});

test("tone is the sRGB curve of the PNG, and exposure counts in stops", () => {
  const half = 0x3800; // 0.5
  const plain = tone.toneTable(0, "clamp");
  assert.equal(plain[0x3c00], 255);
  assert.equal(plain[half], 188);
  assert.equal(plain[0xbc00], 0, "negative light is black");
  assert.equal(tone.toneTable(1, "clamp")[half], 255);
  for (const curve of ["filmic", "reinhard"]) {
    const table = tone.toneTable(0, curve);
    for (let bits = 1; bits < 0x7c00; ++bits) assert.ok(table[bits] >= table[bits - 1], `${curve} falls at ${bits}`);
  }
});

test("a pixel with a NaN is magenta", () => {
  const out = new Uint8ClampedArray(8);
  tone.drawTone({ width: 2, height: 1, passes: 1, rgb: Uint16Array.of(0, 0x7e00, 0, 0, 0, 0) }, tone.toneTable(0, "clamp"), out);
  assert.deepEqual([...out], [255, 0, 255, 255, 0, 0, 0, 255]);
});

test("the error is relative as relMSE weighs it", () => {
  const pixels = (...rgb) => ({ width: 1, height: 1, passes: 1, rgb: Uint16Array.from(rgb) });
  const [error] = tone.relativeError(pixels(0x3800, 0, 0), pixels(0x3c00, 0x3c00, 0x3c00));
  assert.ok(Math.abs(error - 0.5 / Math.sqrt(1.01)) < 1e-3);
});

test("a logarithmic scale spans three decades at most and forgets outliers", () => {
  const values = Float32Array.from({ length: 10_000 }, (_, i) => (i === 0 ? 1e9 : 10 ** (-6 + (6 * i) / 10_000)));
  const { low, high } = tone.rangeOf(values, true);
  assert.ok(high > 0.9 && high <= 1.1);
  assert.ok(Math.abs(low - high / 1000) < 1e-6);
});

test("places in what is sent are places in what was typed", () => {
  const text = ['spec_version = 1', "[job]", 'name = "a"', "", "[integrator]", '  "type" = "sppm" # which', "seed = 18446744073709551615"].join("\n");
  const parsed = spec.parseSpec(text);
  const body = parsed.body([]);
  assert.equal(JSON.parse(body).spec.integrator.type, "sppm");
  assert.match(body, /"seed": 18446744073709551615/, "whole numbers stay whole");
  const lineWith = (part) => body.split("\n").findIndex((line) => line.includes(part)) + 1;
  assert.deepEqual(parsed.placeOf(lineWith('"type"')), { line: 6, column: 3 });
  assert.deepEqual(parsed.placeOf(lineWith('"name"')), { line: 3, column: 1 });
  assert.deepEqual(parsed.placeOf(lineWith('"integrator"')), { line: 5, column: 1 });
  assert.deepEqual(parsed.placeOf(2), { line: 1, column: 1 });
});

test("broken TOML names its place", () => {
  const problem = spec.parseSpec('a = 1\nb = \nc = 2');
  assert.ok(spec.isProblem(problem));
  assert.equal(problem.place.line, 2);
  assert.equal(spec.lineOf("request:12:3"), 12);
  assert.equal(spec.withoutPlace("request:12:3: image.width: too large"), "image.width: too large");
});

test("the example on the page is a job file", () => {
  assert.equal(spec.parseSpec(spec.kExample).sceneFile, "scenes/glass-caustic.glb");
});

test("a scene's buffers and textures are asked for, wherever it lies", async () => {
  const gltf = { buffers: [{ uri: "box.bin" }, { uri: "data:;base64,AA==" }], images: [{ uri: "../maps/wood%20oak.png" }, {}] };
  const scene = new File([JSON.stringify(gltf)], "box.gltf");
  Object.defineProperty(scene, "webkitRelativePath", { value: "" });
  const needed = await files.filesNeeded("scenes/box.gltf", "sky.hdr", [scene]);
  assert.deepEqual(needed.map((n) => n.path), ["scenes/box.gltf", "sky.hdr", "scenes/box.bin", "maps/wood oak.png"]);
  assert.deepEqual(needed.map((n) => n.file !== undefined), [true, false, false, false]);
});

test("every channel that is no colour is looked at by a scale", () => {
  const channels = { beauty: ["R", "G", "B"], radius: ["caustic", "indirect"], normal: ["X", "Y", "Z"], error: ["noise", "bias"] };
  const looks = looksOf({ layers: Object.keys(channels), channels, width: 1, height: 1 });
  assert.deepEqual(looks.map((l) => [l.key, l.kind]), [["beauty", "colour"], ["radius.caustic", "scale"], ["radius.indirect", "scale"], ["normal", "normal"], ["error", "error"]]);
});

test("numbers read well", () => {
  assert.equal(format.compact(3_140_000), "3.14 M");
  assert.equal(format.compact(999_900), "1.00 M");
  assert.equal(format.compact(12), "12");
  assert.equal(format.duration(59.6), "1 min 00 s");
  assert.equal(format.duration(3599.6), "1 h 00 min");
  assert.equal(format.duration(90_000), "1 d 1 h");
  assert.equal(format.percent(0.079), "7.9 %");
});
