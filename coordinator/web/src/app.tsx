// Frame of all pages: header, navigation, what is said of the connection, and which page is shown.
import { useEffect, useRef, useState } from "preact/hooks";

import { connection, signOut, takeTokenFromFragment, token } from "./api.ts";
import { useStore } from "./store.ts";
import { JobPage } from "./views/job.tsx";
import { JobsPage } from "./views/jobs.tsx";
import { LoginPage } from "./views/login.tsx";
import { SubmitPage } from "./views/submit.tsx";
import { WorkersPage } from "./views/workers.tsx";
import { Empty, PageTitle } from "./parts/basics.tsx";

/** The part of the address after #; `""` and `/` are the list of jobs. */
function useRoute(): string {
  const [route, setRoute] = useState(location.hash.slice(1));
  useEffect(() => {
    const changed = (): void => {
      takeTokenFromFragment();
      setRoute(location.hash.slice(1));
    };
    window.addEventListener("hashchange", changed);
    return () => window.removeEventListener("hashchange", changed);
  }, []);
  return route;
}

function Page({ route }: { route: string }) {
  const [head, id] = route.split("/").filter((part) => part !== "");
  if (head === undefined) return <JobsPage />;
  if (head === "jobs" && id !== undefined && /^[a-z0-9-]+$/.test(id)) return <JobPage key={id} id={id} />;
  if (head === "workers") return <WorkersPage />;
  if (head === "submit") return <SubmitPage />;
  return (
    <>
      <PageTitle text="No such page" />
      <Empty title="Nothing is here">
        <p>
          <a href="#/">All jobs</a>
        </p>
      </Empty>
    </>
  );
}

const kLinks = [
  { href: "#/", label: "Jobs", is: (route: string) => route === "" || route === "/" || route.startsWith("/jobs") },
  { href: "#/workers", label: "Workers", is: (route: string) => route.startsWith("/workers") },
  { href: "#/submit", label: "Submit", is: (route: string) => route.startsWith("/submit") },
];

/** Says that the coordinator is away, and that it is back. */
function ConnectionBar() {
  const state = useStore(connection);
  const [back, setBack] = useState(false);
  const before = useRef(state);
  useEffect(() => {
    const returned = before.current === "lost" && state === "up";
    before.current = state;
    setBack(returned);
    if (!returned) return;
    const timer = setTimeout(() => setBack(false), 5000);
    return () => clearTimeout(timer);
  }, [state]);
  const text =
    state === "lost"
      ? "The coordinator does not answer. Trying again…"
      : state === "outdated"
        ? "The coordinator was updated."
        : back
          ? "Connected again."
          : "";
  return (
    <div class={`connection ${state === "lost" ? "tone-bad" : "tone-good"}${text === "" ? " hidden" : ""}`} role="status" data-connection={state}>
      {text}
      {state === "outdated" && (
        <button type="button" class="small" onClick={() => location.reload()}>
          Load the new page
        </button>
      )}
    </div>
  );
}

function Mark() {
  return (
    <svg class="mark" viewBox="0 0 32 32" width="26" height="26" aria-hidden="true">
      <path d="M2 9.5 13 15" stroke="currentColor" />
      <path d="M16 6.5 26 24H6z" stroke="currentColor" />
      <path d="m21 15.5 9 1" class="warm" />
      <path d="m22.5 18.5 7.5 4" class="cool" />
    </svg>
  );
}

export function App() {
  const route = useRoute();
  const signedIn = useStore(token) !== "";
  return (
    <>
      <a class="skip" href="#main" onClick={(e) => (e.preventDefault(), document.querySelector<HTMLElement>("h1")?.focus())}>
        Skip to content
      </a>
      <header class="top">
        <div class="top-inner">
          <a class="brand" href="#/" aria-label="photonfarm, all jobs">
            <Mark />
            <span>photonfarm</span>
          </a>
          {signedIn && (
            <>
              <nav aria-label="Pages">
                {kLinks.map(({ href, label, is }) => (
                  <a key={href} href={href} {...(is(route) ? { "aria-current": "page" as const } : {})}>
                    {label}
                  </a>
                ))}
              </nav>
              <button type="button" class="quiet-button" onClick={signOut}>
                Sign out
              </button>
            </>
          )}
        </div>
      </header>
      <ConnectionBar />
      <main id="main">{signedIn ? <Page route={route} key={route.split("/").slice(0, 3).join("/")} /> : <LoginPage />}</main>
    </>
  );
}
