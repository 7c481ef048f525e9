/// Colours that people with any common colour blindness tell apart (M. Okabe, K. Ito: Color Universal Design, 2008). Black and yellow are left out:
/// they cannot be seen on one of the two backgrounds.
export const kPalette = {
  orange: '#e69f00',
  sky: '#56b4e9',
  green: '#009e73',
  blue: '#0072b2',
  vermilion: '#d55e00',
  purple: '#cc79a7',
} as const;

/// Of the elements of a signal, in their order. Beyond these the lines are dashed.
export const kSeries: string[] = [kPalette.blue, kPalette.orange, kPalette.green, kPalette.purple, kPalette.sky, kPalette.vermilion, '#6b6b6b'];

/// What a role of a track looks like.
export const kRoles = {
  main: kPalette.orange,
  desired: kPalette.sky,
  compliant: kPalette.green,
  other: kPalette.purple,
} as const;

export const kCues = {
  mass: kPalette.vermilion,
  velocity: kPalette.sky,
  stiffness: kPalette.green,
  torque: kPalette.purple,
  contact: kPalette.vermilion,
  hand: kPalette.orange,
  distance: kPalette.blue,
  profile: kPalette.vermilion,
} as const;

/// Of what a monitor asks a robot for: nothing, to slow down, to stop.
export const kZones = [kPalette.green, kPalette.orange, kPalette.vermilion] as const;

/// A colour of the style sheet, which depends on dark and light.
export function style_colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
