// Clear: irradiance / pi that `<< run.light >>` alone throws on each visible surface, directly.
// povray +I<< run.id >>.pov +O<< run.id >>.exr +FE +W<< run.width >> +H<< run.height >> -A -D
<% include "head.inc" %>
<< blocks.shapes >>
<< blocks.lights >>
