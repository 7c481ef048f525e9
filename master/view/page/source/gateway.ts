import type { Connection } from './connection';
import { button, element, short } from './dom';

/// What a gateway answers to GET /robots/NAME. Numbers of slides are in m and N.
interface RobotFacts {
  joints: Record<string, string | number | undefined>[];
}
interface WorkMaster {
  ID: string;
  Description: { Text: string }[];
  Immediate: boolean;
  Href: string;
}
interface Job {
  JobOrder: { JobOrderID: string; WorkMasterID: { ID: string }[] };
  State: { StateText: string }[];
  JobResult: string;
  Light?: string;
  Progress: number;
  Stored: string;
}

const kRefresh = 2000; // ms between two looks at the jobs

function table(heads: string[], rows: (string | Node)[][]): HTMLElement {
  const cells = (kind: 'th' | 'td', row: (string | Node)[]): HTMLElement => element('tr', {}, ...row.map((cell) => element(kind, {}, cell)));
  return element('table', {}, cells('th', heads), ...rows.map((row) => cells('td', row)));
}

/// Limits as the gateway names them, in rad and N·m, or m and N of a slide.
function joint_row(joint: RobotFacts['joints'][number]): string[] {
  const slide = joint['type'] === 'prismatic';
  const number = (name: string): string => (typeof joint[name] === 'number' ? short(joint[name]) : 'none');
  const [angle, torque] = slide ? ['m', 'N'] : ['rad', 'Nm'];
  const range = `${number(`q_min_${angle}`)} to ${number(`q_max_${angle}`)} ${angle}`;
  return [String(joint['name']), range, `${number(`dq_max_${angle}_per_s`)} ${angle}/s`, `${number(`tau_max_${torque}`)} ${slide ? 'N' : 'N·m'}`];
}

/// The files beside the URDF and where their values come from: "drive_train.ssv partly assumed, energy.ssv missing".
function data_of(data: Record<string, string | number> | undefined): string {
  if (data?.['problem'] !== undefined) return String(data['problem']);
  return Object.entries(data ?? {})
    .filter(([file]) => file !== 'joints')
    .map(([file, state]) => `${file} ${state}`)
    .join(', ');
}

/// A robot whose joints are asked for when it is opened.
function robot_entry(connection: Connection, name: string, is_default: boolean, data: string): HTMLElement {
  const box = element('details', {}, element('summary', {}, name, element('span', { class: 'unit' }, `${is_default ? ' default;' : ''} ${data}`)));
  box.addEventListener('toggle', () => {
    if (!box.open || box.childElementCount > 1) return;
    const made = element('div', {}, '…');
    box.append(made);
    connection.ask<RobotFacts>('GET', `robots/${encodeURIComponent(name)}`).then(
      ({ joints }) => made.replaceChildren(table(['joint', 'range', 'speed', 'effort'], joints.map(joint_row))),
      (error: unknown) => made.replaceChildren(error instanceof Error ? error.message : String(error)),
    );
  });
  return box;
}

/// The page of a gateway without a run to show: its robots, services and jobs.
export async function show_gateway(connection: Connection): Promise<void> {
  document.title = 'Cotwin gateway';
  const [{ robots, default: first, data }, { WorkMasters }, { version }] = await Promise.all([
    connection.ask<{ robots: string[]; default?: string; data: Record<string, Record<string, string | number>> }>('GET', 'robots'),
    connection.ask<{ WorkMasters: WorkMaster[] }>('GET', 'work-masters'),
    connection.ask<{ version: string }>('GET', 'health'),
  ]);
  const jobs = element('div', { id: 'jobs' }, 'no job yet');
  const state = element('span', { class: 'state', role: 'status' });
  const services = WorkMasters.map((service) => [element('code', {}, service.ID), service.Description[0]?.Text ?? '', service.Immediate ? 'at once' : 'by a job', element('code', {}, `POST ${service.Href}`)]);
  const change_theme = (): void => {
    const dark = getComputedStyle(document.documentElement).getPropertyValue('--panel').trim() !== '#ffffff';
    document.documentElement.dataset['theme'] = dark ? 'light' : 'dark';
  };
  const part = (title: string, ...content: Node[]): HTMLElement => element('section', {}, element('h2', {}, title), ...content);
  const links = element('p', {}, 'For programs: ', element('a', { href: 'openapi.json' }, 'openapi.json'), ', all that can be asked, as OpenAPI 3.1.');
  document.getElementById('app')!.replaceChildren(
    element('div', { class: 'top' }, element('h1', {}, 'Cotwin gateway'), state, element('span', { class: 'space' }), element('span', { class: 'state' }, version), button('dark / light', 'dark or light', change_theme)),
    element('main', { class: 'gateway' }, part('Robots', ...robots.map((name) => robot_entry(connection, name, name === first, data_of(data[name])))), part('Services', table(['service', 'what it answers', 'when', 'request'], services), links), part('Jobs', jobs)),
  );
  const look = async (): Promise<void> => {
    try {
      const { JobOrders } = await connection.ask<{ JobOrders: Job[] }>('GET', 'job-orders?limit=100');
      state.textContent = '';
      const rows = JobOrders.map(({ JobOrder, State, JobResult, Light, Progress, Stored }) => {
        const progress = JobResult === 'Unknown' ? `${Math.round(100 * Progress)} %` : JobResult;
        return [element('code', {}, JobOrder.JobOrderID), JobOrder.WorkMasterID[0]?.ID ?? '', State.map((part) => part.StateText).join(' '), progress, Light ?? '', Stored.replace('T', ' ').slice(0, 19)];
      });
      if (rows.length > 0) jobs.replaceChildren(table(['job', 'service', 'state', 'result', 'light', 'stored (UTC)'], rows));
      else jobs.replaceChildren('no job yet');
    } catch (error) {
      state.textContent = error instanceof Error ? error.message : String(error);
    }
    setTimeout(() => void look(), kRefresh);
  };
  await look();
}
