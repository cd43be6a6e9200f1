// Surfaces of the estimated albedo, lit by `<< run.light >>`, and the fog, all in one render: what
// photograph * T + V must agree with. The run without fog makes the photograph of that check.
// povray +I<< run.id >>.pov +O<< run.id >>.exr +FE +W<< run.width >> +H<< run.height >> -A -D
<% include "head.inc" %>
#declare Fog_Albedo = array[<< albedos | length >>] { << albedos | map("vector") | join(", ") >> }
<% include "fog_scattering.inc" %>
<< blocks.medium >>
<< blocks.shapes >>
<< blocks.lights >>
<% if not run.without_fog %>
<% if run.container %>
// Sunlight comes from outside: fog in a container the size of the room counts its way from the window.
// (no_shadow would take it out of the light's way altogether.)
box {
  << run.container[0] | vector >> * Metre + 1e-3, << run.container[1] | vector >> * Metre - 1e-3
  hollow pigment { rgbt 1 } finish { ambient 0 diffuse 0 }
  interior { Fog_Scattering(Fog_Samples) }
}
<% else %>
Fog_Scattering(Fog_Samples)
<% endif %>
<% endif %>
