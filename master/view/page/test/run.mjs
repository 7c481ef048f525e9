// Bundles the tests without a browser and runs them by node's runner.
import { spawnSync } from 'node:child_process';
import { build } from 'esbuild';

const names = ['page', 'live'];
await build({ entryPoints: names.map((name) => `test/${name}.test.ts`), bundle: true, platform: 'node', format: 'esm', target: 'node18', outdir: 'built', outExtension: { '.js': '.mjs' }, loader: { '.css': 'empty' }, logLevel: 'warning' });
process.exit(spawnSync(process.execPath, ['--test', ...names.map((name) => `built/${name}.test.mjs`)], { stdio: 'inherit' }).status ?? 1);
