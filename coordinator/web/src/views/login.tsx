import { useState } from "preact/hooks";

import { explain, signIn } from "../api.ts";
import { Notice, PageTitle } from "../parts/basics.tsx";

export function LoginPage() {
  const [value, setValue] = useState("");
  const [problem, setProblem] = useState("");
  const [busy, setBusy] = useState(false);
  const enter = async (): Promise<void> => {
    setBusy(true);
    setProblem("");
    const given = value.trim();
    try {
      const reply = await fetch("/v1/workers", { headers: { Authorization: `Bearer ${given}` }, cache: "no-store" });
      if (reply.status === 401) setProblem("This token is not known here.");
      else if (!reply.ok) setProblem(`The coordinator answered ${reply.status}.`);
      else signIn(given);
    } catch (error) {
      setProblem(explain(error));
    }
    setBusy(false);
  };
  return (
    <div class="login">
      <PageTitle text="Sign in" />
      <p>
        The token lies in the file <code>token</code> of the farm's state folder. It stays in this tab until the tab is closed.
      </p>
      <form
        class="fields"
        onSubmit={(e) => {
          e.preventDefault();
          void enter();
        }}
      >
        <label>
          <span>Token</span>
          <input
            type="password"
            name="token"
            autoComplete="current-password"
            spellcheck={false}
            required
            value={value}
            aria-describedby={problem === "" ? undefined : "login-problem"}
            aria-invalid={problem !== ""}
            onInput={(e) => setValue(e.currentTarget.value)}
          />
        </label>
        <button type="submit" class="primary" disabled={busy}>
          Sign in
        </button>
      </form>
      {problem !== "" && (
        <div id="login-problem">
          <Notice tone="bad" live>
            {problem}
          </Notice>
        </div>
      )}
    </div>
  );
}
