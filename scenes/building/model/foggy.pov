// The street's fog alone, its surfaces black: what foggy.py makes a foggy picture of.
//   povray foggy.pov +W560 +H700 +FE +Ofog.exr Declare=Scattering=0.037 Declare=Extinction=0.037
// Fog fills a ball round the eye. Light comes down through clear air, as it arrives at the ground; what stands in its
// way shades the fog. Knobs, as Declare=Name=Value:
//   Scattering, Extinction   [1/m]
//   Asymmetry                0 scatters evenly, towards 1 ever more forward
//   Reach                    radius of the ball [m]; nothing solid is farther away than that
//   Sky_Lights               0: the sun, of irradiance 1; otherwise the sky, of radiance 1, by so many parallel lights
//   Fog_Samples              points along each ray
#version 3.7;
#ifndef (Scattering) #declare Scattering = 0.0374; #end
#ifndef (Extinction) #declare Extinction = Scattering; #end
#ifndef (Asymmetry) #declare Asymmetry = 0; #end
#ifndef (Reach) #declare Reach = 120; #end
#ifndef (Sky_Lights) #declare Sky_Lights = 0; #end
#ifndef (Fog_Samples) #declare Fog_Samples = 128; #end
#declare Layer = 3;
#include "building.pov"

#if (Sky_Lights = 0)
  light_source { To_Sun * 1e4 rgb 1 / pi parallel point_at 0 }
#else
  // a spiral of directions, each with the same share of the hemisphere; foggy.py knows them too
  #for (I, 0, Sky_Lights - 1)
    #local Up = (I + 0.5) / Sky_Lights;
    #local Turn = I * pi * (3 - sqrt(5));
    light_source {
      <cos(Turn) * sqrt(1 - Up * Up), Up, sin(Turn) * sqrt(1 - Up * Up)> * 1e4 rgb 2 / Sky_Lights   // radiance 1 * 2 pi / lights, over pi
      parallel point_at 0
    }
  #end
#end

sphere {
  Eye, Reach
  hollow no_shadow pigment { rgbt 1 } finish { ambient 0 diffuse 0 }
  interior {
    media {
      method 2 jitter 0 intervals 1 samples Fog_Samples   // a midpoint rule
      scattering { 5, rgb Scattering / 4 eccentricity Asymmetry extinction 0 }   // a quarter: POV-Ray's p is 4 pi times too large
      absorption rgb Extinction
    }
  }
}
