/** Checks every page in the dark colour scheme. */
import { testAllPages } from "./all-pages";

testAllPages(true);
