// Clear: light of `<< run.light >>` with interreflection, on surfaces of the albedo estimated so far.
// povray +I<< run.id >>.pov +O<< run.id >>.exr +FE +W<< run.width >> +H<< run.height >> -A -D
<% include "head.inc" %>
#ifndef (Fog_Bounces) #declare Fog_Bounces = << run.bounces >>; #end
#declare Fog_Albedo = array[<< albedos | length >>] { << albedos | map("vector") | join(", ") >> }

#if (Fog_Bounces > 0)
  global_settings {
    radiosity {
      count << run.rays >>, 1600 nearest_count 8 error_bound 0.4 recursion_limit Fog_Bounces
      pretrace_start 0.08 pretrace_end 0.02 low_error_factor 0.7 gray_threshold 0 brightness 1
      adc_bailout 0.001 minimum_reuse 0.02 always_sample off media off normal off
    }
  }
#end
<< blocks.shapes >>
<< blocks.lights >>
