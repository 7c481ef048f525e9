// Builds view.html: one file with script and styles inside. A content security policy permits exactly these two, by their hashes, and no
// connection. `cotwin view` replaces the line <!--data--> by the recording.
import { createHash } from 'node:crypto';
import { readFileSync } from 'node:fs';
import { defineConfig } from 'vite';

const hash_of = (text) => `'sha256-${createHash('sha256').update(text, 'utf8').digest('base64')}'`;

/// Licences of what the page contains.
const licences = ['fflate', 'three', 'uplot'].map((name) => `${name}\n\n${readFileSync(`node_modules/${name}/LICENSE`, 'utf8')}`).join('\n').replaceAll('--', '- -');

function one_file() {
  return {
    name: 'one-file',
    enforce: 'post',
    generateBundle(_, bundle) {
      let script = '';
      let style = '';
      for (const [name, item] of Object.entries(bundle)) {
        if (name.endsWith('.js')) script += item.code;
        if (name.endsWith('.css')) style += item.source;
        delete bundle[name];
      }
      // Neither may end its element or open a comment.
      script = script.replaceAll('</script', '<\\/script').replaceAll('<!--', '\\x3c!--').trim();
      style = style.trim();
      if (/<\//.test(style)) throw new Error('the style sheet contains </');
      const policy = `default-src 'none'; script-src ${hash_of(script)}; style-src ${hash_of(style)}; img-src data: blob:; connect-src data:; base-uri 'none'; form-action 'none'`;
      const page = [
        '<!doctype html>',
        '<html lang="en">',
        '<head>',
        '<meta charset="utf-8">',
        `<meta http-equiv="Content-Security-Policy" content="${policy}">`,
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<link rel="icon" href="data:,">',
        '<title>cotwin view</title>',
        `<style>${style}</style>`,
        '</head>',
        '<body>',
        '<div id="app"></div>',
        '<!--data-->',
        `<script>${script}</script>`,
        `<!--\n${licences}-->`,
        '</body>',
        '</html>',
        '',
      ].join('\n');
      this.emitFile({ type: 'asset', fileName: 'view.html', source: page });
    },
  };
}

export default defineConfig({
  build: {
    target: 'es2022',
    assetsInlineLimit: 1e9,
    cssCodeSplit: false,
    modulePreload: false,
    chunkSizeWarningLimit: 4000,
    reportCompressedSize: false,
    rollupOptions: {
      input: 'source/main.ts',
      output: { format: 'iife', inlineDynamicImports: true },
    },
  },
  plugins: [one_file()],
});
