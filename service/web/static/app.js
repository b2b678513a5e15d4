// The live page: pictures on the left, the scan and its details on the right.

import { render } from "../vendor/preact.js";
import { html } from "./html.js";
import { connection, rigLink, useStore } from "./store.js";
import { BurstsPanel } from "./panels/bursts.js";
import { FramesPanel } from "./panels/frames.js";
import { Heading } from "./panels/heading.js";
import { MapPanel } from "./panels/map.js";
import { ProfilePanel } from "./panels/profile.js";
import { ScanPanel } from "./panels/scan.js";
import { Side } from "./panels/side.js";
import { SurfacePanel } from "./panels/surface.js";

function Page() {
  const link = useStore(rigLink), { state } = useStore(connection);
  const old = state !== "open" || !link.up;
  return html`<${Heading} />
    <main class=${old ? "old" : ""}>
      <${MapPanel} /><${SurfacePanel} /><${FramesPanel} /><${ProfilePanel} /><${BurstsPanel} />
      <${ScanPanel} /><${Side} />
    </main>`;
}

render(html`<${Page} />`, document.getElementById("page"));
