// Connects, and asks for the map, while the rest of the page is still on its way.

import { connect, want } from "./link.js";

want(["fused/depth"]);
connect();
