/** Labels on a page that has no script of its own for them. */
import { start } from "./labels.js";

start();
