// What the API answers: the fields of coordinator/job_service.h under the same names.

export type JobState = "queued" | "preparing" | "running" | "waiting" | "paused" | "finishing" | "done" | "failed" | "cancelled";

export interface Job {
  id: string;
  name: string;
  state: JobState;
  message: string;
  priority: number;
  max_workers?: number;
  submitted_by?: string;
  paused_by?: string;
  algorithm: string;
  width: number;
  height: number;
  passes_done: number;
  passes_wanted: number;
  stop_seconds: number;
  stop_error: number;
  rounds: number;
  estimated_error: number | null;
  seconds: number;
  seconds_left: number | null;
  rays: number;
  photon_paths: number;
  rays_per_second: number;
  passes_per_second: number;
  workers: number;
  units_done: number;
  units_repeated: number;
  bytes_received: number;
  merge_seconds: number;
  image_hash: string;
  scene_hash: string;
  spec_hash: string;
  warnings: string[];
  /** "checkpoint", "results": what the policy of retention has removed. */
  expired: string[];
  submitted_unix_ms: number | null;
  started_unix_ms: number | null;
  ended_unix_ms: number | null;
}

export interface Worker {
  name: string;
  host: string;
  process: number;
  state: string;
  message: string;
  job_id: string;
  units_held: number;
  rays: number;
  sub_passes: number;
  seconds_since_heard: number | null;
}

export interface LogEntry {
  number: number;
  unix_ms: number;
  level: string;
  source: string;
  text: string;
}

export interface ConvergencePoint {
  seconds: number;
  passes: number;
  rounds: number;
  rays: number;
  estimated_error: number | null;
}

export interface Layers {
  layers: string[];
  channels: Record<string, string[]>;
  width: number;
  height: number;
}

export interface Problem {
  type: string;
  title: string;
  status: number;
  detail: string;
  place?: string;
}

export const hasEnded = (state: JobState): boolean => state === "done" || state === "failed" || state === "cancelled";
/** Its image may still change by itself. */
export const isActive = (state: JobState): boolean => !hasEnded(state) && state !== "paused";

/** Why a job that has ended has no image; "" where it has one, and while it may still get one. */
export function whyNoImage(job: Job): string {
  if (!hasEnded(job.state)) return "";
  if (job.passes_done === 0) return "The job ended before its first sub-pass: there is no image.";
  if (job.expired.includes("results")) return "The image has expired.";
  return job.state === "cancelled" && job.image_hash === "" ? "The image was discarded." : "";
}

/** How much of the job is done, 0 to 1, by the nearest of its stops; null when nothing tells. */
export function progressOf(job: Job): number | null {
  if (job.state === "done") return 1;
  const shares: number[] = [];
  if (job.passes_wanted > 0) shares.push(job.passes_done / job.passes_wanted);
  if (job.stop_seconds > 0) shares.push(job.seconds / job.stop_seconds);
  if (job.stop_error > 0 && job.estimated_error !== null && job.estimated_error > 0) {
    // Progressive photon mapping's error falls as the cube root of its passes.
    shares.push((job.stop_error / job.estimated_error) ** 3);
  }
  return shares.length > 0 ? Math.min(1, Math.max(...shares)) : null;
}
