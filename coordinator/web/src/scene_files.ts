// Which files a scene is made of, and bringing them to the coordinator by the hash of their content.
import { Refused, send } from "./api.ts";

export interface Needed {
  path: string; // below the job's folder
  file: File | undefined;
}

const baseName = (path: string): string => path.split("/").at(-1) ?? path;

/** The chosen file that a path means: the one that ends like it, else the one of its name. */
function pick(files: File[], path: string): File | undefined {
  const relative = (file: File): string => (file.webkitRelativePath === "" ? file.name : file.webkitRelativePath);
  return files.find((f) => relative(f) === path || relative(f).endsWith(`/${path}`)) ?? files.find((f) => f.name === baseName(path));
}

interface Gltf {
  buffers?: { uri?: string }[];
  images?: { uri?: string }[];
}

function resolve(folder: string[], uri: string): string {
  const parts = [...folder];
  for (const part of decodeURIComponent(uri).split("/")) {
    if (part === "..") parts.pop();
    else if (part !== "." && part !== "") parts.push(part);
  }
  return parts.join("/");
}

const kBinaryMagic = 0x46546c67; // "glTF"

/** The JSON of a .gltf or the first chunk of a .glb; undefined when it is neither. */
async function readGltf(file: File): Promise<Gltf | undefined> {
  try {
    const head = new DataView(await file.slice(0, 20).arrayBuffer());
    const binary = head.byteLength === 20 && head.getUint32(0, true) === kBinaryMagic;
    const text = binary ? await file.slice(20, 20 + head.getUint32(12, true)).text() : await file.text();
    return JSON.parse(text) as Gltf;
  } catch {
    return undefined;
  }
}

/** Everything that the job opens, as far as the chosen files tell. */
export async function filesNeeded(sceneFile: string, environment: string, chosen: File[]): Promise<Needed[]> {
  const paths = new Set<string>();
  if (sceneFile !== "") paths.add(sceneFile);
  if (environment !== "") paths.add(environment);
  const scene = sceneFile === "" ? undefined : pick(chosen, sceneFile);
  const gltf = scene === undefined ? undefined : await readGltf(scene);
  const folder = sceneFile.split("/").slice(0, -1);
  for (const { uri } of [...(gltf?.buffers ?? []), ...(gltf?.images ?? [])]) {
    if (uri !== undefined && !uri.startsWith("data:")) paths.add(resolve(folder, uri));
  }
  return [...paths].map((path) => ({ path, file: pick(chosen, path) }));
}

export interface Uploaded {
  path: string;
  sha256: string;
  bytes: number;
}

const hex = (bytes: ArrayBuffer): string => [...new Uint8Array(bytes)].map((b) => b.toString(16).padStart(2, "0")).join("");

/** Puts the file into the coordinator's store unless its content is there already. */
export async function upload(path: string, file: File): Promise<Uploaded> {
  if (!("subtle" in crypto)) {
    throw new Error("This browser hashes files only on pages of https or of this machine: use one of those, or photonfarm submit.");
  }
  const content = await file.arrayBuffer();
  const sha256 = hex(await crypto.subtle.digest("SHA-256", content));
  try {
    await send(`/v1/blobs/${sha256}`, { method: "HEAD" });
  } catch (error) {
    if (!(error instanceof Refused) || error.problem.status !== 404) throw error;
    await send(`/v1/blobs/${sha256}`, { method: "PUT", body: content, headers: { "Content-Type": "application/octet-stream" } });
  }
  return { path, sha256, bytes: file.size };
}

/** The same for two clicks on one button, another for the next job. */
export const newKey = (): string => hex(crypto.getRandomValues(new Uint8Array(16)).buffer as ArrayBuffer);
