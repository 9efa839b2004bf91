// The ways in which a job's image can be looked at: colours, one channel by a scale, or the estimated error.
import type { Layers } from "./model.ts";
import type { ScaleName } from "./tone.ts";

export interface Look {
  key: string;
  label: string;
  kind: "colour" | "normal" | "scale" | "error";
  /** Layers to fetch. */
  layers: string[];
  channel: number;
  scale: ScaleName;
  logarithmic: boolean;
  unit: string;
}

const kPlain = { channel: 0, scale: "viridis" as const, logarithmic: false, unit: "" };
const kUnits: Record<string, string> = { depth: " m", radius: " m" };
const kTitles: Record<string, string> = {
  gather_points: "Gather points",
  cache_records: "Cache records",
};
const titled = (name: string): string => kTitles[name] ?? name.charAt(0).toUpperCase() + name.slice(1);

export function looksOf(layers: Layers): Look[] {
  const looks: Look[] = [];
  for (const name of layers.layers) {
    const channels = layers.channels[name] ?? ["R", "G", "B"];
    const label = titled(name);
    if (name === "error") {
      looks.push({ ...kPlain, key: "error", label: "Error map", kind: "error", layers: ["error", "beauty"], scale: "inferno", logarithmic: true });
    } else if (channels.join("") === "RGB") {
      looks.push({ ...kPlain, key: name, label, kind: "colour", layers: [name] });
    } else if (name === "normal") {
      looks.push({ ...kPlain, key: name, label, kind: "normal", layers: [name] });
    } else {
      const many = channels.length > 1;
      channels.forEach((channel, i) =>
        looks.push({
          ...kPlain,
          key: many ? `${name}.${channel}` : name,
          label: many ? `${label}, ${channel}` : label,
          kind: "scale",
          layers: [name],
          channel: i,
          logarithmic: name === "photons" || name === "radius",
          unit: kUnits[name] ?? "",
        }),
      );
    }
  }
  return looks;
}
