import svelte from "eslint-plugin-svelte";
import ts from "typescript-eslint";
import svelteConfig from "./svelte.config.js";

const browserOnly = (name, where) => ({ name, message: `Only ${where} may do this.` });

const forbid = (regex) => ({ "no-restricted-imports": ["error", { patterns: [{ regex }] }] });

export default ts.config(
  { ignores: ["node_modules", "src/api/types.gen.ts"] },
  ...ts.configs.strictTypeChecked,
  ...svelte.configs.recommended,
  {
    languageOptions: {
      parserOptions: {
        projectService: { allowDefaultProject: ["*.js", "*.ts", "dev/*.mjs"] },
        extraFileExtensions: [".svelte"],
        tsconfigRootDir: import.meta.dirname,
      },
    },
    rules: {
      "@typescript-eslint/restrict-template-expressions": ["error", { allowNumber: true }],
      "@typescript-eslint/no-confusing-void-expression": [
        "error",
        { ignoreArrowShorthand: true, ignoreVoidOperator: true },
      ],
      "@typescript-eslint/no-meaningless-void-operator": "off",
      "@typescript-eslint/unbound-method": "off",
      "svelte/no-navigation-without-resolve": "off", // no SvelteKit here
      "svelte/prefer-svelte-reactivity": "off", // plain maps are what drawing loops and requests need
      "no-restricted-globals": [
        "error",
        browserOnly("fetch", "src/api/http.ts"),
        browserOnly("WebSocket", "src/live/socket.ts"),
        browserOnly("localStorage", "src/logic/storage.ts"),
      ],
      "no-console": "error",
    },
  },
  {
    files: ["**/*.svelte", "**/*.svelte.ts"],
    languageOptions: { parserOptions: { parser: ts.parser, svelteConfig } },
    rules: {
      // Types of component properties do not reach the linter; svelte-check sees them.
      "@typescript-eslint/no-unsafe-argument": "off",
      "@typescript-eslint/no-unsafe-assignment": "off",
      "@typescript-eslint/no-unsafe-call": "off",
      "@typescript-eslint/no-unsafe-member-access": "off",
    },
  },
  {
    files: ["src/api/http.ts", "src/live/socket.ts", "src/logic/storage.ts"],
    rules: { "no-restricted-globals": "off" },
  },
  // Panels never import panels: what two of them need lives in ui/. Below, nothing knows what is above it.
  { files: ["src/panels/*"], rules: forbid("^\\./|/panels/|/places/") },
  { files: ["src/panels/*/*"], rules: forbid("^\\.\\./(?!\\.\\./)|/panels/|/places/") },
  { files: ["src/ui/**"], rules: forbid("/panels/|/places/") },
  { files: ["src/{live,logic,api,i18n}/**"], rules: forbid("/panels/|/places/|/ui/") },
  { files: ["**/*.js", "**/*.mjs", "vite.config.ts"], extends: [ts.configs.disableTypeChecked] },
);
