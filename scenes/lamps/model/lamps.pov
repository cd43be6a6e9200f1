// A street at night: lamps in two rows, a car's headlights, houses. Lambertian surfaces, physical falloff:
// irradiance intensity / (d^2 + radius^2); a POV-Ray light colour is irradiance / pi.
#version 3.7;
#include "numbers.inc"
global_settings {
  assumed_gamma 1 max_trace_level 10
  radiosity { count 200 nearest_count 6 error_bound 0.5 recursion_limit 2 pretrace_start 0.08 pretrace_end 0.02
              low_error_factor 0.6 gray_threshold 0 brightness 1 minimum_reuse 0.02 normal off }
}
#ifndef (Emitters_Seen) #declare Emitters_Seen = 1; #end   // 0: bulbs are black where they are seen; what they light stays
#ifndef (Lamps_On) #declare Lamps_On = 1; #end             // 0: the sky alone
#ifndef (Sky_On) #declare Sky_On = 1; #end                 // 0: all but the sky
background { rgb Sky_On * Night_Sky }
#declare Seed = seed(7);

#declare Tilt = radians(Camera_Pitch);
camera {
  perspective location <0, Camera_Height, 0>
  direction <0, sin(Tilt), -cos(Tilt)> * image_width / (2 * tan(radians(Field_Of_View / 2)))
  right x * image_width up <0, cos(Tilt), sin(Tilt)> * image_height
}

#macro Matt(Albedo) pigment { rgb Albedo } finish { ambient 0 diffuse 1 } #end
#macro Rough(Albedo, Size)
  pigment { granite scale Size color_map { [0 rgb Albedo * 0.75] [1 rgb Albedo * 1.25] } } finish { ambient 0 diffuse 1 }
#end
#macro Bulb_Light(Place, Intensity, Radius)
  #if (Lamps_On) light_source { Place rgb Intensity / (2 * pi * Radius * Radius) fade_power 2 fade_distance Radius #ifdef (In_Fog) media_attenuation on #end } #end
  sphere { Place, Radius pigment { rgb 1 } finish { ambient 0 diffuse 0 emission Lamps_On * Emitters_Seen * Intensity / (pi * Radius * Radius) } no_shadow no_radiosity }
#end

// ground
box { <-Facade_Side, -1, -Street_End - 10>, <Facade_Side, 0, 20> Rough(Road_Albedo, 0.5) }
#for (Side, -1, 1, 2)
  box { <Side * Pavement_Edge, -0.5, -Street_End>, <Side * (Facade_Side + 1), Pavement_Height, 20>
        texture { pigment { checker rgb Pavement_Albedo, rgb Pavement_Albedo * 0.9 scale 0.5 } finish { ambient 0 diffuse 1 } } }
#end
#for (I, 0, 24)
  box { <-0.07, 0, -3 - I * 3>, <0.07, 0.004, -4.4 - I * 3> Matt(<0.6, 0.6, 0.58>) }
#end

// houses along the street, windows set back, some lit
#macro House(Side, From, To, Height)
  #local Wall = Side * Facade_Side;
  difference {
    box { <Wall, 0, -To>, <Wall + Side * 6, Height, -From> }
    #for (Z, From + 1.2, To - 2, 2.6)
      #for (Y, 1.0, Height - 2.2, 3.1)
        box { <Wall - Side * 0.1, Y, -Z - 1.3>, <Wall + Side * 0.25, Y + 1.7, -Z> }
      #end
    #end
    Rough(Facade_Albedo * (0.75 + 0.5 * rand(Seed)), 1.3)
  }
  #for (Z, From + 1.2, To - 2, 2.6)
    #for (Y, 1.0, Height - 2.2, 3.1)
      box { <Wall + Side * 0.2, Y, -Z - 1.3>, <Wall + Side * 0.24, Y + 1.7, -Z>
        #if (rand(Seed) < 0.22) pigment { rgb 1 } finish { ambient 0 diffuse 0 emission Lamps_On * <0.35, 0.22, 0.09> * (0.4 + rand(Seed)) }
        #else Matt(0.03) #end }
    #end
  #end
#end
House(-1, -8, 17, 9.5)
House(-1, 17.5, 41, 12.5)
House(-1, 41.5, 79, 10.5)
House(1, 13, 38, 11)
House(1, 38.5, 79, 9)
difference {
  box { <-20, 0, -Street_End - 6>, <20, 13, -Street_End> }
  #for (X, -15, 14, 3) #for (Y, 1.2, 10, 3.1) box { <X, Y, -Street_End - 0.3>, <X + 1.4, Y + 1.7, -Street_End + 1> } #end #end
  Rough(Facade_Albedo, 1.5)
}

// lamps
#for (I, 0, Lamp_Pairs - 1)
  #for (Side, -1, 1, 2)
    #local Z = -(Lamp_First + I * Lamp_Distance);
    cylinder { <Side * (Lamp_Side + 0.5), 0, Z>, <Side * (Lamp_Side + 0.5), Lamp_Height + 0.3, Z>, 0.06 Matt(0.12) }
    cylinder { <Side * (Lamp_Side + 0.5), Lamp_Height + 0.3, Z>, <Side * Lamp_Side, Lamp_Height + 0.35, Z>, 0.035 Matt(0.12) }
    Bulb_Light(<Side * Lamp_Side, Lamp_Height, Z>, Lamp_Intensity, Lamp_Radius)
  #end
#end

// a car that comes towards the camera
union {
  box { <-0.85, 0.32, 0>, <0.85, 0.86, 4.1> }
  box { <-0.74, 0.86, 1.1>, <0.74, 1.4, 3.3> }
  #for (X, -0.72, 0.72, 1.44) #for (Z, 0.7, 3.3, 2.6) cylinder { <X - 0.1, 0.32, Z>, <X + 0.1, 0.32, Z>, 0.32 } #end #end
  Matt(<0.09, 0.03, 0.03>)
  scale <1, 1, -1> translate <Car_X, 0, Car_Front - 0.02>
}
#for (Side, -1, 1, 2)
  #local Place = <Car_X + Side * Beam_Side, Beam_Height, Car_Front>;
  #if (Lamps_On)
  light_source {
    Place rgb Beam_Intensity / (2 * pi * Beam_Radius * Beam_Radius)
    spotlight point_at Beam_Target radius Beam_Inner falloff Beam_Outer tightness 0
    fade_power 2 fade_distance Beam_Radius
    #ifdef (In_Fog) media_attenuation on #end
  }
  #end
  sphere { Place, Beam_Radius scale <1, 1, 1> pigment { rgb 1 } finish { ambient 0 diffuse 0 emission Lamps_On * Emitters_Seen * Beam_Intensity / (pi * Beam_Radius * Beam_Radius) } no_shadow no_radiosity }
#end

// a tree before the right house, its crown against the sky
#declare Crown = union {
  #for (I, 0, 220)
    #local A = 2 * pi * rand(Seed); #local H = 2 * rand(Seed) - 1; #local R = 1.5 * pow(rand(Seed), 0.5);
    sphere { <R * cos(A) * sqrt(1 - H * H), 3.9 + 1.3 * H, R * sin(A) * sqrt(1 - H * H)>, 0.13 + 0.17 * rand(Seed) }
  #end
  Matt(<0.05, 0.10, 0.03>)
}
union {
  object { Crown }
  cylinder { <0, 0, 0>, <0, 3.4, 0>, 0.13 Matt(<0.10, 0.07, 0.05>) }
  translate <6.6, 0, -14>
}

// ground truth in fog (make truth) brings the fog along, and takes another camera where it needs one
#ifdef (In_Fog) #include "in_fog.inc" #end
