// Checks the dashboard's types, bundles src/ and writes it as a C++ source: node bundle.mjs SOURCE_FOLDER STAGE OUTPUT.cpp
// STAGE holds node_modules; the sources are copied beside it, where type checker and bundler look for packages.
import { spawnSync } from "node:child_process";
import { createHash } from "node:crypto";
import { cpSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { basename, extname, join } from "node:path";

const [source, stage, output] = process.argv.slice(2);
rmSync(join(stage, "src"), { recursive: true, force: true });
cpSync(join(source, "src"), join(stage, "src"), { recursive: true });
cpSync(join(source, "tsconfig.json"), join(stage, "tsconfig.json"));

const check = spawnSync(process.execPath, [join(stage, "node_modules/typescript/bin/tsc"), "-p", stage, "--pretty", "false"], {
  cwd: stage,
  encoding: "utf8",
});
if (check.status !== 0) {
  process.stderr.write(check.stdout.replaceAll(/^src/gm, join(source, "src")) + check.stderr);
  process.exit(1);
}

const esbuild = createRequire(join(stage, "package.json"))("esbuild");
const result = await esbuild.build({
  absWorkingDir: stage,
  entryPoints: { app: "src/main.tsx", style: "src/style/main.css", icon: "src/icon.svg" },
  entryNames: "assets/[name]-[hash]",
  outdir: join(stage, "dist"),
  bundle: true,
  minify: true,
  write: false,
  format: "esm",
  target: ["es2022"],
  jsx: "automatic",
  jsxImportSource: "preact",
  loader: { ".svg": "copy" },
  logLevel: "warning",
});

const types = {
  ".js": "text/javascript; charset=utf-8",
  ".css": "text/css; charset=utf-8",
  ".svg": "image/svg+xml",
  ".html": "text/html; charset=utf-8",
};
const files = result.outputFiles.map((file) => ({ path: `/assets/${basename(file.path)}`, content: Buffer.from(file.contents), hashed: true }));
const address = (name) => files.find((file) => file.path.startsWith(`/assets/${name}-`)).path;
const page = readFileSync(join(source, "src/index.html"), "utf8")
  .replace("app.js", address("app"))
  .replace("style.css", address("style"))
  .replace("icon.svg", address("icon"));
files.unshift({ path: "/", content: Buffer.from(page), hashed: false });

/** A C++ string literal: octal escapes of three digits never run into what follows. */
function literal(bytes) {
  const lines = [];
  for (let i = 0; i < bytes.length; i += 4096) {
    let text = "";
    for (const byte of bytes.subarray(i, i + 4096)) {
      const plain = byte >= 0x20 && byte < 0x7f && byte !== 0x22 && byte !== 0x5c && byte !== 0x3f;
      text += plain ? String.fromCharCode(byte) : `\\${byte.toString(8).padStart(3, "0")}`;
    }
    lines.push(`"${text}"`);
  }
  return lines.join("\n    ");
}

let code = '// Written by bundle.mjs.\n#include "coordinator/web/web_files.h"\n\n#include <array>\n\nnamespace pf {\nnamespace {\n';
files.forEach((file, i) => {
  code += `\nconstexpr char kContent${i}[] =\n    ${literal(file.content)};\n`;
});
code += `\nconstexpr std::array<WebFile, ${files.length}> kFiles = {{\n`;
files.forEach((file, i) => {
  const type = types[extname(file.path) || ".html"];
  const hash = createHash("sha256").update(file.content).digest("hex").slice(0, 16);
  code += `    {"${file.path}", "${type}", "\\"${hash}\\"", ${file.hashed}, {kContent${i}, sizeof kContent${i} - 1}},\n`;
});
code += "}};\n\n}  // namespace\n\nstd::span<const WebFile> web_files() { return kFiles; }\n\n}  // namespace pf\n";
writeFileSync(output, code);
