import "./app.css";
import "uplot/dist/uPlot.min.css";
import { mount } from "svelte";
import App from "./App.svelte";
import { app } from "./live/app.svelte";

const target = document.getElementById("app");
if (!target) throw new Error("index.html has no #app");
void app.start();
export default mount(App, { target });
