// Bundles the tests without a browser and runs them by node's runner.
import { spawnSync } from 'node:child_process';
import { build } from 'esbuild';

await build({ entryPoints: ['test/page.test.ts'], bundle: true, platform: 'node', format: 'esm', target: 'node18', outfile: 'built/page.test.mjs', logLevel: 'warning' });
process.exit(spawnSync(process.execPath, ['--test', 'built/page.test.mjs'], { stdio: 'inherit' }).status ?? 1);
