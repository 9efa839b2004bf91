// A job file as it is typed: TOML -> the JSON that the API takes, and places in that JSON back to places in the TOML.
import { parse, TomlError } from "smol-toml";

export interface Place {
  line: number; // from 1
  column: number; // from 1
}

export interface ParsedSpec {
  /** A whole request body: `{"spec": ..., "files": ...}`. */
  body: (files: { path: string; sha256: string; bytes: number }[]) => string;
  /** Where the text has what stands at this place of the body. */
  placeOf: (line: number) => Place;
  name: string;
  sceneFile: string;
  environment: string;
}

export interface SyntaxProblem {
  message: string;
  place: Place;
}

type Value = string | number | bigint | boolean | Date | Value[] | { [key: string]: Value };
type Table = { [key: string]: Value };

const isTable = (value: Value | undefined): value is Table =>
  typeof value === "object" && !Array.isArray(value) && !(value instanceof Date);

/** One key a line, so that a line number names a key; `paths[line - 1]` is the key's dotted path. */
function writeJson(value: Table, path: string, indent: string, lines: string[], paths: string[]): void {
  const keys = Object.keys(value);
  keys.forEach((key, i) => {
    const comma = i + 1 < keys.length ? "," : "";
    const here = path === "" ? key : `${path}.${key}`;
    const member = value[key];
    const head = `${indent}${JSON.stringify(key)}: `;
    if (isTable(member)) {
      lines.push(`${head}{`);
      paths.push(here);
      writeJson(member, here, `${indent}  `, lines, paths);
      lines.push(`${indent}}${comma}`);
    } else {
      lines.push(`${head}${scalar(member)}${comma}`);
    }
    paths.push(here);
  });
}

function scalar(value: Value | undefined): string {
  if (typeof value === "bigint") return value.toString();
  if (typeof value === "number" && !Number.isFinite(value)) return "null"; // the service says what it expects instead
  if (Array.isArray(value)) return `[${value.map(scalar).join(", ")}]`;
  return JSON.stringify(value) ?? "null";
}

/** Line and column of each dotted path's key. */
function placesOf(text: string): Map<string, Place> {
  const places = new Map<string, Place>();
  let table = "";
  text.split("\n").forEach((line, i) => {
    const header = /^\s*\[([^[\]]+)\]/.exec(line);
    const plain = (key: string): string =>
      key
        .split(".")
        .map((part) => part.trim().replace(/^(["'])(.*)\1$/, "$2"))
        .join(".");
    if (header !== null) {
      table = plain(header[1] ?? "");
      places.set(table, { line: i + 1, column: line.indexOf("[") + 1 });
      return;
    }
    const key = /^(\s*)([A-Za-z0-9_"'.\- ]+?)\s*=/.exec(line);
    if (key === null) return;
    const path = plain(key[2] ?? "");
    places.set(table === "" ? path : `${table}.${path}`, { line: i + 1, column: (key[1]?.length ?? 0) + 1 });
  });
  return places;
}

const textAt = (table: Value | undefined, key: string): string => {
  const value = isTable(table) ? table[key] : undefined;
  return typeof value === "string" ? value : "";
};

export function parseSpec(text: string): ParsedSpec | SyntaxProblem {
  let spec: Table;
  try {
    spec = parse(text, { integersAsBigInt: "asNeeded" }) as Table;
  } catch (error) {
    if (!(error instanceof TomlError)) throw error;
    const message = (error.message.split("\n")[0] ?? "").replace(/^Invalid TOML document: /, "");
    return { message, place: { line: error.line, column: error.column } };
  }
  const lines = ["{", '"spec": {'];
  const paths = ["", ""];
  writeJson(spec, "", "  ", lines, paths);
  const places = placesOf(text);
  return {
    body: (files) => [...lines, `}, "files": ${JSON.stringify(files)}}`].join("\n"),
    placeOf(line) {
      // An unwritten key is missed in its table, or else at the top.
      for (let path = paths[line - 1] ?? ""; path !== ""; path = path.split(".").slice(0, -1).join(".")) {
        const place = places.get(path);
        if (place !== undefined) return place;
      }
      return { line: 1, column: 1 };
    },
    name: textAt(spec["job"], "name"),
    sceneFile: textAt(spec["scene"], "file"),
    environment: textAt(spec["scene"], "environment"),
  };
}

export const isProblem = (result: ParsedSpec | SyntaxProblem): result is SyntaxProblem => "message" in result;

/** The line of `request:line:column`. */
export function lineOf(place: string | undefined): number | undefined {
  const match = /^[^:]*:(\d+):\d+$/.exec(place ?? "");
  return match === null ? undefined : Number(match[1]);
}

/** A problem's detail without its place, which the page shows in the text's own terms. */
export const withoutPlace = (detail: string): string => detail.replace(/^[^\s:]*:\d+:\d+: /, "");

export const kExample = `# Every key: jobs/SPEC.md. Values that are left out have the defaults.
spec_version = 1

[job]
name = "glass-caustic"
priority = 50

[scene]
file = "scenes/glass-caustic.glb"   # chosen beside

[image]
width = 640
height = 480

[integrator]
type = "sppm"
photons = 500000
error_estimate = true               # an error map, and the error against time

[stop]                              # whichever comes first
passes = 256
`;
