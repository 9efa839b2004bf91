import { render } from "preact";

import { meetCoordinator, takeTokenFromFragment } from "./api.ts";
import { App } from "./app.tsx";

takeTokenFromFragment();
meetCoordinator();
const root = document.getElementById("app");
if (root !== null) render(<App />, root);
