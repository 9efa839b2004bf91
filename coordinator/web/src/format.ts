// Numbers, durations and times as people read them.

const kUnits = ["", "k", "M", "G", "T"];

/** Three significant digits and a unit's prefix: 3.14 M. */
export function compact(value: number): string {
  if (!Number.isFinite(value)) return "–";
  let scale = 0;
  let rest = Math.abs(value);
  while (rest >= 999.5 && scale < kUnits.length - 1) {
    rest /= 1000;
    ++scale;
  }
  const digits = scale === 0 && Number.isInteger(value) ? 0 : rest >= 99.95 ? 0 : rest >= 9.995 ? 1 : 2;
  return `${value < 0 ? "−" : ""}${rest.toFixed(digits)}${scale > 0 ? ` ${kUnits[scale]}` : ""}`;
}

export const whole = (value: number): string => Math.round(value).toLocaleString("en-US").replaceAll(",", "\u202f");

export const bytes = (value: number): string => `${compact(value)}${value >= 999.5 ? "B" : " B"}`;

export function percent(share: number): string {
  const value = 100 * share;
  return `${value >= 10 || value === 0 ? value.toFixed(0) : value >= 1 ? value.toFixed(1) : value.toPrecision(2)} %`;
}

/** 4.2 s, 3 min 12 s, 5 h 04 min, 2 d 3 h */
export function duration(seconds: number | null): string {
  if (seconds === null || !Number.isFinite(seconds)) return "–";
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  const s = Math.round(seconds);
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min ${String(s % 60).padStart(2, "0")} s`;
  const minutes = Math.round(s / 60);
  if (minutes < 24 * 60) return `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
  const hours = Math.round(minutes / 60);
  return `${Math.floor(hours / 24)} d ${hours % 24} h`;
}

export function ago(unixMs: number | null, now = Date.now()): string {
  if (unixMs === null || unixMs === 0) return "–";
  const seconds = (now - unixMs) / 1000;
  if (seconds < 5) return "just now";
  if (seconds < 60) return `${Math.floor(seconds)} s ago`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ago`;
  if (seconds < 36 * 3600) return `${Math.floor(seconds / 3600)} h ago`;
  return `${Math.floor(seconds / 86400)} d ago`;
}

export const clockTime = (unixMs: number): string => new Date(unixMs).toLocaleTimeString("en-GB");
export const dateTime = (unixMs: number | null): string =>
  unixMs === null || unixMs === 0 ? "–" : new Date(unixMs).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "medium" });

/** An error as people read it: 0.0123 */
export const figure = (value: number): string => (value === 0 ? "0" : value.toPrecision(3));
/** The same of a number that somebody chose: 0.01 */
export const chosen = (value: number): string => String(Number(value.toPrecision(3)));
