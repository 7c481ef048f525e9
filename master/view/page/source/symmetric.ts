/// Eigenvalues and eigenvectors of a symmetric 3×3 matrix given as xx, xy, xz, yy, yz, zz, by Jacobi's rotations. Values in falling order, the vectors
/// of a right-handed system, as columns [x, y, z].
export interface Principal {
  values: [number, number, number];
  axes: [number, number, number][];
}

export function principal_of(m: ArrayLike<number>): Principal {
  const a = [
    [m[0]!, m[1]!, m[2]!],
    [m[1]!, m[3]!, m[4]!],
    [m[2]!, m[4]!, m[5]!],
  ];
  const v = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  const size = Math.max(...Array.from({ length: 6 }, (_, i) => Math.abs(m[i]!)));
  for (let sweep = 0; sweep < 30; ++sweep) {
    if (Math.abs(a[0]![1]!) + Math.abs(a[0]![2]!) + Math.abs(a[1]![2]!) <= 1e-15 * size) break;
    for (const [p, q] of [
      [0, 1],
      [0, 2],
      [1, 2],
    ] as const) {
      if (a[p]![q] === 0) continue;
      const theta = (a[q]![q]! - a[p]![p]!) / (2 * a[p]![q]!);
      const t = Math.sign(theta || 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
      const c = 1 / Math.sqrt(t * t + 1);
      const s = t * c;
      for (let k = 0; k < 3; ++k) {
        const x = a[k]![p]!;
        a[k]![p] = c * x - s * a[k]![q]!;
        a[k]![q] = s * x + c * a[k]![q]!;
      }
      for (let k = 0; k < 3; ++k) {
        const x = a[p]![k]!;
        a[p]![k] = c * x - s * a[q]![k]!;
        a[q]![k] = s * x + c * a[q]![k]!;
        const y = v[k]![p]!;
        v[k]![p] = c * y - s * v[k]![q]!;
        v[k]![q] = s * y + c * v[k]![q]!;
      }
    }
  }
  const order = [0, 1, 2].sort((i, j) => a[j]![j]! - a[i]![i]!);
  const axes = order.map((i): [number, number, number] => [v[0]![i]!, v[1]![i]!, v[2]![i]!]);
  const [x, y] = [axes[0]!, axes[1]!];
  axes[2] = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
  return { values: [a[order[0]!]![order[0]!]!, a[order[1]!]![order[1]!]!, a[order[2]!]![order[2]!]!], axes };
}

/// Share of the largest eigenvalue of a matrix without negative ones below which another one is 0: packed numbers are rounded.
const kRank = 1e-5;

/// principal_of() of a matrix J Jᵀ: eigenvalues are 0 in directions in which J has none but rounding.
export function principal_of_product(m: ArrayLike<number>): Principal {
  const { values, axes } = principal_of(m);
  return { values: values.map((value) => (value <= kRank * values[0] ? 0 : value)) as Principal['values'], axes };
}

/// The mass along u, 1/(uᵀ m u), for a mobility m in 1/kg; Infinity where nothing can move along u.
export function mass_along(m: ArrayLike<number>, u: ArrayLike<number>): number {
  const mobility = quadratic(m, u);
  return mobility <= kRank * principal_of(m).values[0] ? Infinity : 1 / mobility;
}

/// uᵀ m u.
export function quadratic(m: ArrayLike<number>, u: ArrayLike<number>): number {
  const [x, y, z] = [u[0]!, u[1]!, u[2]!];
  return m[0]! * x * x + m[3]! * y * y + m[5]! * z * z + 2 * (m[1]! * x * y + m[2]! * x * z + m[4]! * y * z);
}
