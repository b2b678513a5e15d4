// Connects while the rest of the page is still on its way.

import { connect } from "./link.js";

connect();
