import { svelte } from "@sveltejs/vite-plugin-svelte";
import { defineConfig } from "vitest/config";

/** The service that `npm run dev` talks to; a script variable, not a setting of the product. */
const service = process.env.NAVDECK_DEV_SERVICE ?? "http://127.0.0.1:8080";

export default defineConfig({
  base: "./",
  plugins: [svelte()],
  build: {
    outDir: "../server/web_dist",
    emptyOutDir: true,
    target: "es2022",
    chunkSizeWarningLimit: 500,
  },
  server: {
    host: "127.0.0.1",
    proxy: {
      "/api": { target: service, ws: true },
      "/view": { target: service, ws: true },
    },
  },
  test: { include: ["tests/**/*.test.ts"], environment: "node" },
});
