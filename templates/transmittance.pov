// Fog that only takes light away, on the way from `<< run.light >>` to the surface and on to the eye.
// Divided by the clear run of the same light it is that light's transmittance (Zhao et al. 2013, eq. 5).
// povray +I<< run.id >>.pov +O<< run.id >>.exr +FE +W<< run.width >> +H<< run.height >> -A -D
<% include "head.inc" %>
<% include "fog_scattering.inc" %>
<< blocks.medium >>
<< blocks.shapes >>
<< blocks.lights >>
Fog_Extinction()
