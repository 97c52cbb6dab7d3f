/** Checks every page in the light colour scheme. */
import { testAllPages } from "./all-pages";

testAllPages(false);
