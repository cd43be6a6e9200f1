// Light of `<< run.light >>` that the fog scatters towards the eye; surfaces are black.
// povray +I<< run.id >>.pov +O<< run.id >>.exr +FE +W<< run.width >> +H<< run.height >> -A -D
<% include "head.inc" %>
<% include "fog_scattering.inc" %>
<< blocks.medium >>
<< blocks.shapes >>
<< blocks.lights >>
<% if run.scatters %>
Fog_Scattering(Fog_Samples)
<% endif %>
